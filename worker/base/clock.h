/* Time in seconds by the monotonic clock. Its zero has no meaning: use differences only. */
#ifndef KILN_WORKER_BASE_CLOCK_H
#define KILN_WORKER_BASE_CLOCK_H

#include <stdint.h>
#include <time.h>

static inline double kiln_clock_seconds(void)
{
    struct timespec t = {0, 0};
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Time span of work that ran in the background, beside other work. */
struct kiln_aside {
    double begin, end; /* s, kiln_clock_seconds; 0: no such work */
    double waited;     /* s within the span that others waited for the result */
    uint64_t count;    /* number of things made */
};

#endif
