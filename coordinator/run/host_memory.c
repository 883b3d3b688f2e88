#include "coordinator/run/host_memory.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { PATH_ROOM = 4096 };

/* The number in the file; UINT64_MAX: it has none ("max"), or there is no such file. */
static uint64_t read_limit(const char *path)
{
    char text[64] = "";
    uint64_t limit = UINT64_MAX;
    FILE *file = fopen(path, "re");
    if (file == NULL)
        return limit;
    if (fgets(text, sizeof text, file) != NULL && text[0] >= '0' && text[0] <= '9') {
        errno = 0;
        limit = strtoull(text, NULL, 10);
        limit = errno == 0 ? limit : UINT64_MAX;
    }
    (void)fclose(file);
    return limit;
}

/* The least limit of the group `group` (changed) and the groups above it. Within a container the path may be that of
 * the host, which is not there: then only the topmost counts. */
static uint64_t least_limit(const char *folder, const char *controller, char *group, const char *name)
{
    uint64_t least = UINT64_MAX;
    for (;;) {
        char path[PATH_ROOM];
        char *last = strrchr(group, '/');
        if (last != NULL && last[1] == '\0')
            *last = '\0';
        if (snprintf(path, sizeof path, "%s%s%s/%s", folder, controller, group, name) < (int)sizeof path) {
            const uint64_t limit = read_limit(path);
            least = limit < least ? limit : least;
        }
        last = strrchr(group, '/');
        if (last == NULL)
            return least;
        *last = '\0';
    }
}

uint64_t kiln_host_memory_of(uint64_t machine, const char *groups, const char *folder)
{
    static const char one[] = "0::", several[] = ":memory:";
    char line[PATH_ROOM];
    uint64_t least = machine;
    FILE *file = fopen(groups, "re");
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        char *of_memory = strstr(line, several);
        uint64_t limit = UINT64_MAX;
        line[strcspn(line, "\n")] = '\0';
        if (strncmp(line, one, strlen(one)) == 0)
            limit = least_limit(folder, "", line + strlen(one), "memory.max");
        else if (of_memory != NULL)
            limit = least_limit(folder, "/memory", of_memory + strlen(several), "memory.limit_in_bytes");
        least = limit < least ? limit : least;
    }
    if (file != NULL)
        (void)fclose(file);
    return least;
}

uint64_t kiln_host_memory(void)
{
    const uint64_t machine = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
    return kiln_host_memory_of(machine, "/proc/self/cgroup", "/sys/fs/cgroup");
}
