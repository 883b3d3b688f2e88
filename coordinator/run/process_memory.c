#include "coordinator/run/process_memory.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

uint64_t kiln_process_memory(enum kiln_memory_figure figure)
{
    static const struct {
        const char *file, *key;
    } places[] = {[KILN_MEMORY_NOW] = {"/proc/self/status", "VmRSS:"},
                  [KILN_MEMORY_PEAK] = {"/proc/self/status", "VmHWM:"},
                  [KILN_MEMORY_SHARE] = {"/proc/self/smaps_rollup", "Pss:"}};
    const size_t length = strlen(places[figure].key);
    uint64_t kibibytes = 0;
    char line[256];
    FILE *file = fopen(places[figure].file, "re");
    while (file != NULL && kibibytes == 0 && fgets(line, sizeof line, file) != NULL)
        if (strncmp(line, places[figure].key, length) == 0)
            kibibytes = strtoull(line + length, NULL, 10);
    if (file != NULL)
        (void)fclose(file);
    return kibibytes * 1024u;
}
