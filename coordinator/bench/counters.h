/* Counters of the processor, read by Linux' perf_event_open over a child process and all that it starts. */
#ifndef KILN_COORDINATOR_BENCH_COUNTERS_H
#define KILN_COORDINATOR_BENCH_COUNTERS_H

#include <stddef.h>
#include <stdint.h>

/* What is counted, as in struct perf_event_attr. */
struct kiln_counter {
    const char *name;
    uint32_t type;
    uint64_t config;
};

/* Of the caches, in user code: references to the last level and those that missed there, reads of the first level's
 * data cache and those that missed there. */
enum { KILN_COUNTERS = 4 };
extern const struct kiln_counter kiln_cache_counters[KILN_COUNTERS];

struct kiln_counters {
    int files[KILN_COUNTERS]; /* -1: this one cannot be counted */
    size_t count;
    int why; /* errno of the first that cannot be counted; 0: all can */
};

/* Begins to count, in this thread and in all processes that it starts from now on. At most KILN_COUNTERS. Release with
 * kiln_counters_close. */
void kiln_counters_open(struct kiln_counters *counters, const struct kiln_counter *which, size_t count);
/* Counts so far, of processes that have ended and of this thread. Where more was counted than the processor has
 * counters for, the kernel counted each for a part of the time, and the value is scaled up to all of it. NaN: it could
 * not be counted. */
void kiln_counters_read(const struct kiln_counters *counters, double values[KILN_COUNTERS]);
void kiln_counters_close(struct kiln_counters *counters);

/* Why counters could not be read, and the remedy: a sentence for `why`, which is not 0. */
const char *kiln_counters_remedy(int why);

#endif
