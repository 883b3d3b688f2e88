/* Who of the ranks has fallen silent, wherever the others stand.
 *
 * A thread of each process sends signs of life to rank 0 (rank 0's go to the last rank) at least every second or eighth
 * of the limit, over a communicator of its own, while the process's main thread computes, waits in MPI, reads or
 * writes. A sign says where the rank stands. A rank whose last one is older than the limit is named on stderr with its
 * host and place, and the job is aborted with KILN_RANK_LOST.
 *
 * Covered so from create to destroy: a process that is stopped, a host that is lost or frozen, a network that is cut.
 * MPI_Init and what is before create, and MPI_Finalize, have a deadline by the alarm clock. Of processes that live but
 * do not come on:
 *
 * - Ranks that wait for each other. A sign says in which call of MPI its rank waits, if it does, and since when nothing
 * has moved there (waiting.h). When that is so on all ranks for a third of the limit (at least 5 s), and for the time
 * that what they move takes at 10 MB/s or kiln_watchdog_blocking grants, rank 0 says who waits where and ends the job.
 * Where one rank is still at work, none is judged.
 * - A rank that in a pass does not come back from a batch within the limit, and within four times its batch before.
 * - A rank that, in no pass, neither computes nor reads nor writes nor waits for others for the limit (activity.h);
 * that one read or write takes ten times as long. A device's work outside passes is in dispatches far shorter than
 * that.
 * - A rank that waits in a call for longer than kiln_watchdog_blocking grants says so and ends the job, without a name.
 *
 * Whatever else a living process does (import, BVH, surface, lightmaps, files, preview) may take as long as it takes. A
 * rank that died is noticed by mpirun, which names it and ends the others.
 *
 * The thread needs MPI_THREAD_MULTIPLE; where MPI has less there is no watchdog, and rank 0 says so.
 *
 * For tests: with KILN_HALT_RANK=RANK:PLACE in the environment the rank stops itself (SIGSTOP) when it says that it is
 * at the place. */
#ifndef KILN_COORDINATOR_MPI_WATCHDOG_H
#define KILN_COORDINATOR_MPI_WATCHDOG_H

#include <mpi.h>

#include "worker/base/status.h"

struct kiln_watchdog;

/* Before MPI_Init: the process ends itself (KILN_RANK_LOST), with a sentence, when it has not come through
 * kiln_watchdog_create within so many seconds (0: it may wait for ever). */
void kiln_watchdog_start(int rank, double seconds);

/* Collective. `limit` in seconds; 0, or a single rank: *watchdog is NULL, which all functions here take. Destroy with
 * kiln_watchdog_destroy. */
int kiln_watchdog_create(struct kiln_watchdog **watchdog, MPI_Comm communicator, double limit,
                         struct kiln_error *error);
/* Collective; the wait for the others is watched. From then on the process has the limit's time to end: it ends itself
 * (KILN_RANK_LOST) should MPI_Finalize not return. */
void kiln_watchdog_destroy(struct kiln_watchdog **watchdog);

/* Where this rank stands from now on (copied); it need not come back for any time. */
void kiln_watchdog_phase(struct kiln_watchdog *watchdog, const char *phase);
/* This rank, in a pass, has come back from a batch of `seconds` and will soon do so again; `share` of the pass is done.
 */
void kiln_watchdog_batch(struct kiln_watchdog *watchdog, double share, double seconds);
/* The pass is over, or rests. */
void kiln_watchdog_rest(struct kiln_watchdog *watchdog);
/* A call begins, `what` (static), that takes longer than twice the limit and `seconds` only when something is wrong;
 * NULL: it is over. */
void kiln_watchdog_blocking(struct kiln_watchdog *watchdog, const char *what, double seconds);

#endif
