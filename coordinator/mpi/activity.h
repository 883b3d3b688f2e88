/* Activity monitor: tells whether this process makes progress, from counters in /proc.
 *
 * A thread of the process samples the counters at intervals. The process is active when it used processor time, when
 * its main thread was scheduled, when it read or wrote, or when a child process of it did. Not counted are the
 * processor time of the sampling thread, and 1 % of a core, which idle threads use. A main thread or child in
 * uninterruptible disk wait (state D) also counts as active, since a hanging disk looks like a slow one; the length of
 * that wait is kept apart. */
#ifndef KILN_COORDINATOR_MPI_ACTIVITY_H
#define KILN_COORDINATOR_MPI_ACTIVITY_H

#include <stdbool.h>
#include <stdint.h>

/* All zero before the first sample. Times are seconds on the clock of the caller. */
struct kiln_activity {
    double sampled;    /* time of the last sample */
    double idle_since; /* begin of the present idle time; 0: the process is active */
    double disk_since; /* begin of the present disk wait; 0: none */
    uint64_t switches; /* context switches of the main thread */
    uint64_t ticks;    /* processor time of the main thread, in the kernel's ticks */
    uint64_t bytes;    /* read and written by the process */
    uint64_t children; /* processor time of all children in ticks, plus one for each child */
    double processor;  /* processor time of the process without the sampling thread, s */
};

/* Takes a sample at time `now`, in seconds on any clock that does not jump. Always call it from the same thread. */
void kiln_activity_sample(struct kiln_activity *activity, double now);
/* Seconds up to the last sample for which the process has been idle; 0 when it is active. */
double kiln_activity_idle(const struct kiln_activity *activity);
/* Seconds up to the last sample for which every sample found a disk wait. */
double kiln_activity_disk(const struct kiln_activity *activity);

#endif
