#include "coordinator/bench/counters.h"

#include <errno.h>
#include <linux/perf_event.h>
#include <math.h>
#include <sys/syscall.h>
#include <unistd.h>

#define CACHE_READ(cache, result)                                                                                      \
    ((uint64_t)(cache) | (uint64_t)PERF_COUNT_HW_CACHE_OP_READ << 8 | (uint64_t)(result) << 16)

const struct kiln_counter kiln_cache_counters[KILN_COUNTERS] = {
    {"cache_references", PERF_TYPE_HARDWARE, PERF_COUNT_HW_CACHE_REFERENCES},
    {"cache_misses", PERF_TYPE_HARDWARE, PERF_COUNT_HW_CACHE_MISSES},
    {"l1d_reads", PERF_TYPE_HW_CACHE, CACHE_READ(PERF_COUNT_HW_CACHE_L1D, PERF_COUNT_HW_CACHE_RESULT_ACCESS)},
    {"l1d_read_misses", PERF_TYPE_HW_CACHE, CACHE_READ(PERF_COUNT_HW_CACHE_L1D, PERF_COUNT_HW_CACHE_RESULT_MISS)}};

/* User code only: the kernel's own may be counted by few. */
static int open_one(const struct kiln_counter *counter)
{
    struct perf_event_attr attributes = {.type = counter->type,
                                         .size = sizeof attributes,
                                         .config = counter->config,
                                         .read_format = PERF_FORMAT_TOTAL_TIME_ENABLED | PERF_FORMAT_TOTAL_TIME_RUNNING,
                                         .inherit = 1,
                                         .exclude_kernel = 1,
                                         .exclude_hv = 1};
    return (int)syscall(SYS_perf_event_open, &attributes, 0, -1, -1, (unsigned long)PERF_FLAG_FD_CLOEXEC);
}

void kiln_counters_open(struct kiln_counters *counters, const struct kiln_counter *which, size_t count)
{
    *counters = (struct kiln_counters){.count = count};
    for (size_t i = 0; i < count; i++) {
        counters->files[i] = open_one(&which[i]);
        if (counters->files[i] < 0 && counters->why == 0)
            counters->why = errno;
    }
}

void kiln_counters_read(const struct kiln_counters *counters, double values[KILN_COUNTERS])
{
    for (size_t i = 0; i < KILN_COUNTERS; i++) {
        uint64_t read_values[3]; /* the count; ns in which it was wanted, and in which it was counted */
        values[i] = (double)NAN;
        if (i < counters->count && counters->files[i] >= 0 &&
            read(counters->files[i], read_values, sizeof read_values) == (ssize_t)sizeof read_values &&
            read_values[2] > 0)
            values[i] = (double)read_values[0] * ((double)read_values[1] / (double)read_values[2]);
    }
}

void kiln_counters_close(struct kiln_counters *counters)
{
    for (size_t i = 0; i < counters->count; i++) {
        if (counters->files[i] >= 0)
            (void)close(counters->files[i]);
        counters->files[i] = -1;
    }
}

const char *kiln_counters_remedy(int why)
{
    if (why == EACCES || why == EPERM)
        return "cache misses were not counted, for this system does not permit it: 'sysctl "
               "kernel.perf_event_paranoid=2' "
               "permits it, and a container must also be allowed to call perf_event_open";
    if (why == ENOENT || why == EOPNOTSUPP || why == ENODEV)
        return "not all cache misses were counted, for the processor shows no such counters here: a virtual machine "
               "must pass them on, or measure on the machine itself";
    if (why == ENOSYS)
        return "cache misses were not counted, for this system has no perf_event_open: a container must be allowed to "
               "call it";
    return "not all cache misses were counted, for perf_event_open failed: too many open files, or another program has "
           "the counters";
}
