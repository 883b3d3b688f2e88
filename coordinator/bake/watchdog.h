/* Who of the ranks has fallen silent, wherever the others stand.
 *
 * A thread of each process sends signs of life to rank 0 (rank 0's go to the last rank) at least every second or eighth of the limit, over a
 * communicator of its own, while the process's main thread computes, waits in MPI, reads or writes. A sign says where the rank stands. A
 * rank whose last one is older than the limit is named on stderr with its host and place, and the job is aborted with KILN_RANK_LOST.
 *
 * Covered so from create to destroy, which is all of a bake but MPI_Init and MPI_Finalize: a process that is stopped, a host that is lost or
 * frozen, a network that is cut. Of a process that lives but does not come on, the watchdog knows in two places: a rank that does not come
 * back from a batch of a pass within the limit, and within four times its batch before, is named in the same way; and a rank that
 * waits in a call for longer than kiln_watchdog_blocking grants says so and ends the job, without a name. Everything else that a living
 * process does (import, BVH, surface, lightmaps, files, preview) may take as long as it takes. A rank that died is noticed by mpirun,
 * which names it and ends the others.
 *
 * The thread needs MPI_THREAD_MULTIPLE; where MPI has less there is no watchdog, and rank 0 says so.
 *
 * For tests: with KILN_HALT_RANK=RANK:PLACE in the environment the rank stops itself (SIGSTOP) when it says that it is at the place. */
#ifndef KILN_COORDINATOR_BAKE_WATCHDOG_H
#define KILN_COORDINATOR_BAKE_WATCHDOG_H

#include <mpi.h>

#include "worker/base/status.h"

struct kiln_watchdog;

/* Collective. `limit` in seconds; 0, or a single rank: *watchdog is NULL, which all functions here take. Destroy with kiln_watchdog_destroy. */
int kiln_watchdog_create(struct kiln_watchdog **watchdog, MPI_Comm communicator, double limit, struct kiln_error *error);
/* Collective; the wait for the others is watched. From then on the process has the limit's time to end: it ends itself (KILN_RANK_LOST)
 * should MPI_Finalize not return. */
void kiln_watchdog_destroy(struct kiln_watchdog **watchdog);

/* Where this rank stands from now on (copied); it need not come back for any time. */
void kiln_watchdog_phase(struct kiln_watchdog *watchdog, const char *phase);
/* This rank, in a pass, has come back from a batch of `seconds` and will soon do so again; `share` of the pass is done. */
void kiln_watchdog_batch(struct kiln_watchdog *watchdog, double share, double seconds);
/* The pass is over, or rests. */
void kiln_watchdog_rest(struct kiln_watchdog *watchdog);
/* A call begins, `what` (static), that takes longer than twice the limit and `seconds` only when something is wrong; NULL: it is over. */
void kiln_watchdog_blocking(struct kiln_watchdog *watchdog, const char *what, double seconds);

#endif
