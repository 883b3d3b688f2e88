#include "coordinator/mpi/activity.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define IDLE_CORES 0.01      /* cores that idle threads may use */
enum { IDLE_BYTES = 65536 }; /* bytes a second that monitoring threads may read and write */

/* State of a process or thread, from its stat file in /proc. */
struct state {
    char letter;    /* R running, S sleeping, D disk wait, ... */
    uint64_t ticks; /* processor time */
};

/* The program name in the file stands in brackets and may itself contain brackets, so the last bracket is searched. */
static bool read_state(const char *path, struct state *state)
{
    char text[512];
    FILE *file = fopen(path, "re");
    const size_t length = file != NULL ? fread(text, 1, sizeof text - 1, file) : 0;
    unsigned long long user = 0, system = 0;
    if (file != NULL)
        (void)fclose(file);
    text[length] = '\0';
    const char *rest = strrchr(text, ')');
    if (rest == NULL ||
        sscanf(rest, ") %c %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %llu %llu", &state->letter, &user, &system) != 3)
        return false;
    state->ticks = user + system;
    return true;
}

/* Returns the sum of the values in lines `one` and `other` of a file in /proc. */
static uint64_t read_sum(const char *path, const char *one, const char *other)
{
    char line[128];
    uint64_t sum = 0;
    FILE *file = fopen(path, "re");
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        const char *colon = strchr(line, ':');
        const size_t length = colon != NULL ? (size_t)(colon - line) : 0;
        if (colon != NULL && ((length == strlen(one) && memcmp(line, one, length) == 0) ||
                              (length == strlen(other) && memcmp(line, other, length) == 0)))
            sum += strtoull(colon + 1, NULL, 10);
    }
    if (file != NULL)
        (void)fclose(file);
    return sum;
}

/* Adds the processor time of the thread's child processes; sets *disk if one is in disk wait. */
static void add_children(const char *thread, uint64_t *ticks, bool *disk)
{
    char path[300], child[64];
    long number;
    (void)snprintf(path, sizeof path, "/proc/self/task/%.200s/children", thread);
    FILE *file = fopen(path, "re");
    while (file != NULL && fscanf(file, "%ld", &number) == 1) {
        struct state state;
        (void)snprintf(child, sizeof child, "/proc/%ld/stat", number);
        if (!read_state(child, &state))
            continue;
        *ticks += state.ticks + 1; /* + 1, so that starting a child counts as activity */
        *disk = *disk || state.letter == 'D';
    }
    if (file != NULL)
        (void)fclose(file);
}

static void sample_children(uint64_t *ticks, bool *disk)
{
    DIR *threads = opendir("/proc/self/task");
    const struct dirent *entry;
    while (threads != NULL && (entry = readdir(threads)) != NULL)
        if (entry->d_name[0] != '.')
            add_children(entry->d_name, ticks, disk);
    if (threads != NULL)
        (void)closedir(threads);
}

static double clock_seconds(clockid_t clock)
{
    struct timespec time = {0, 0};
    (void)clock_gettime(clock, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

void kiln_activity_sample(struct kiln_activity *a, double now)
{
    struct kiln_activity next = {.sampled = now};
    struct state main = {'R', 0};
    char path[64];
    bool disk = false;
    (void)snprintf(path, sizeof path, "/proc/self/task/%ld/stat", (long)getpid());
    const bool seen = read_state(path, &main);
    (void)snprintf(path, sizeof path, "/proc/self/task/%ld/status", (long)getpid());
    next.switches = read_sum(path, "voluntary_ctxt_switches", "nonvoluntary_ctxt_switches");
    next.bytes = read_sum("/proc/self/io", "rchar", "wchar");
    next.ticks = main.ticks;
    next.processor = clock_seconds(CLOCK_PROCESS_CPUTIME_ID) - clock_seconds(CLOCK_THREAD_CPUTIME_ID);
    sample_children(&next.children, &disk);
    disk = disk || main.letter == 'D';
    const double passed = now - a->sampled;
    const bool active = !seen || a->sampled <= 0.0 || disk || next.switches != a->switches || next.ticks != a->ticks ||
                        next.children != a->children || next.processor - a->processor > IDLE_CORES * passed ||
                        (double)(next.bytes - a->bytes) > IDLE_BYTES * passed;
    next.idle_since = active ? 0.0 : a->idle_since > 0.0 ? a->idle_since : a->sampled;
    next.disk_since = !disk ? 0.0 : a->disk_since > 0.0 ? a->disk_since : now;
    *a = next;
}

double kiln_activity_idle(const struct kiln_activity *a)
{
    return a->idle_since > 0.0 ? a->sampled - a->idle_since : 0.0;
}
double kiln_activity_disk(const struct kiln_activity *a)
{
    return a->disk_since > 0.0 ? a->sampled - a->disk_since : 0.0;
}
