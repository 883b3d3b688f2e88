/* Seconds of the monotonic clock, whose zero means nothing: for differences. */
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

/* Work that was done beside other work. */
struct kiln_aside {
    double begin, end; /* s of this clock; 0: there was none */
    double waited;     /* s, of these, in which its result was waited for */
    uint64_t count;    /* of what it made */
};

#endif
