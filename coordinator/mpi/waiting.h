/* Where this process waits for others.
 *
 * Every call of MPI that may wait is seen through MPI's profiling interface (MPI 3.1, chapter 14): the definitions of
 * MPI_Allreduce and its like in waiting.c take the place of the library's, for kiln and for what it is linked with
 * (HDF5), and call PMPI_Allreduce. Loops that wait with MPI_Test say so themselves. Only calls of the thread that
 * called kiln_waiting_follow count, so that the watchdog's own messages do not. What this costs is two stores to memory
 * a call.
 *
 * Calls that read and write files are not among them: a process in one is at work. */
#ifndef KILN_COORDINATOR_MPI_WAITING_H
#define KILN_COORDINATOR_MPI_WAITING_H

#include <stdint.h>

struct kiln_waiting {
    const char *call; /* static: "MPI_Allreduce"; NULL: it does not wait */
    uint64_t steps;   /* moves on with every call that begins or ends, and with every MPI_Test that finds something */
    uint64_t bytes;   /* that the call moves, and those before it that may not have arrived yet; of this rank */
};

/* From now on this thread's calls are seen: once, by the main thread. */
void kiln_waiting_follow(void);
/* A loop begins that does nothing but wait (what it waits for, static), and ends. */
void kiln_waiting_begin(const char *call);
void kiln_waiting_end(void);

/* For any thread. */
void kiln_waiting_look(struct kiln_waiting *waiting);

#endif
