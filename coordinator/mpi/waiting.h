/* Wait tracker: records in which MPI call the main thread of this process waits for other ranks.
 *
 * Every MPI call that may block is intercepted through MPI's profiling interface (MPI 3.1, chapter 14): waiting.c
 * defines MPI_Allreduce and the others, which kiln and the libraries that it is linked with (HDF5) then call, and each
 * of them calls PMPI_Allreduce and so on. Loops that wait with MPI_Test call kiln_waiting_begin and kiln_waiting_end
 * themselves. Only calls of the thread that called kiln_waiting_follow are recorded, so the watchdog's own messages are
 * not. The cost is two stores to memory for each call.
 *
 * MPI calls that read and write files are not intercepted: a process in one of them counts as active. */
#ifndef KILN_COORDINATOR_MPI_WAITING_H
#define KILN_COORDINATOR_MPI_WAITING_H

#include <stdint.h>

struct kiln_waiting {
    const char *call; /* such as "MPI_Allreduce", a static string; NULL: the thread does not wait */
    uint64_t steps;   /* counts calls that began or ended, and MPI_Tests that found something */
    uint64_t bytes;   /* sent or received by this rank in the call, and in earlier ones that may be under way */
};

/* From now on the calls of this thread are recorded. Call it once, in the main thread. */
void kiln_waiting_follow(void);
/* Marks the begin and end of a loop that only waits. `call`, a static string, names what it waits for. */
void kiln_waiting_begin(const char *call);
void kiln_waiting_end(void);

/* Copies the present record. May be called by any thread. */
void kiln_waiting_look(struct kiln_waiting *waiting);

#endif
