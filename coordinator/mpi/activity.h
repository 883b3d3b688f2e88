/* Whether this process does anything: a thread of it asks once in a while.
 *
 * A process is at work when it uses processor time, when its main thread goes to sleep and wakes, when it reads or
 * writes, or when a child that it has started does so. Time of the asking thread and what a process's idle threads need
 * (1 % of a core) do not count. A main thread or child that waits for a disk, which cannot be told from a slow one, is
 * at work too, and known apart. */
#ifndef KILN_COORDINATOR_MPI_ACTIVITY_H
#define KILN_COORDINATOR_MPI_ACTIVITY_H

#include <stdbool.h>
#include <stdint.h>

/* All zero: not asked yet. */
struct kiln_activity {
    double asked;      /* when it was last asked; s on the clock of the caller */
    double idle_since; /* 0: it was at work */
    double disk_since; /* 0: it does not wait for a disk */
    uint64_t switches, ticks, bytes, children;
    double processor; /* s */
};

/* To be called by one thread, at intervals of its choice: `now` on any clock that does not jump. */
void kiln_activity_ask(struct kiln_activity *activity, double now);
double kiln_activity_idle(const struct kiln_activity *activity); /* s without a sign of work until it was last asked */
/* s in which each time it was asked it waited for a disk */
double kiln_activity_disk(const struct kiln_activity *activity);

#endif
