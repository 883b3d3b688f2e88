#include "coordinator/mpi/activity.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define IDLE_SHARE 0.01      /* of a core */
enum { IDLE_BYTES = 65536 }; /* a second: what threads that watch write */

/* What /proc says of a process's or thread's state. */
struct state {
    char letter;
    uint64_t ticks; /* of processor time */
};

/* The name in brackets may hold anything, brackets too. */
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

/* The sum of the lines of a file in /proc whose names are among two. */
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

/* Processor time and states of the children that a thread has started. */
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
        *ticks += state.ticks + 1; /* a new one is a sign of work */
        *disk = *disk || state.letter == 'D';
    }
    if (file != NULL)
        (void)fclose(file);
}

static void look_at_children(uint64_t *ticks, bool *disk)
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

void kiln_activity_ask(struct kiln_activity *a, double now)
{
    struct kiln_activity next = {.asked = now};
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
    look_at_children(&next.children, &disk);
    disk = disk || main.letter == 'D';
    const double passed = now - a->asked;
    const bool works = !seen || a->asked <= 0.0 || disk || next.switches != a->switches || next.ticks != a->ticks ||
                       next.children != a->children || next.processor - a->processor > IDLE_SHARE * passed ||
                       (double)(next.bytes - a->bytes) > IDLE_BYTES * passed;
    next.idle_since = works ? 0.0 : a->idle_since > 0.0 ? a->idle_since : a->asked;
    next.disk_since = !disk ? 0.0 : a->disk_since > 0.0 ? a->disk_since : now;
    *a = next;
}

double kiln_activity_idle(const struct kiln_activity *a)
{
    return a->idle_since > 0.0 ? a->asked - a->idle_since : 0.0;
}
double kiln_activity_disk(const struct kiln_activity *a)
{
    return a->disk_since > 0.0 ? a->asked - a->disk_since : 0.0;
}
