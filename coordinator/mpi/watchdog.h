/* Watchdog: ends the job when a rank hangs or is lost, and names that rank.
 *
 * A thread of each process sends heartbeats to rank 0 (rank 0 sends its own to the last rank), at least one a second
 * and eight within the limit. It uses a communicator of its own, and works while the main thread computes, waits in
 * MPI, reads or writes. A heartbeat says what its rank is doing. If the last heartbeat of a rank is older than the
 * limit, the receiver names the rank, its host and its phase on stderr and aborts the job with KILN_RANK_LOST. This
 * finds, between create and destroy, a stopped process, a lost or frozen host, and a cut network. MPI_Init and
 * everything before create, and MPI_Finalize, have a deadline by alarm(2).
 *
 * The heartbeats also show processes that are alive but make no progress:
 *
 * - Deadlock. A heartbeat says in which MPI call its rank waits, if any, and since when that call has made no progress
 * (waiting.h). Rank 0 ends the job and prints who waits where if all ranks have waited so for a third of the limit (at
 * least 5 s), plus the time that their data takes at 10 MB/s, plus what kiln_watchdog_blocking allows. As long as one
 * rank computes, this rule does not apply.
 * - A rank that within a pass has not finished a batch for longer than the limit and four times its previous batch.
 * - A rank that outside passes has been idle for the limit: it neither computed, read, wrote nor waited for other ranks
 * (activity.h). A single read or write may take ten times the limit. GPU work outside passes consists of dispatches
 * that are far shorter than the limit.
 * - A rank that waits in a call for longer than kiln_watchdog_blocking allows. It ends the job itself, and cannot name
 * the rank that it waits for.
 *
 * Anything else that a running process does (import, BVH, surface, lightmaps, files, preview) may take any time. A rank
 * that died is noticed by mpirun, which names it and ends the others.
 *
 * The thread needs MPI_THREAD_MULTIPLE. Where the MPI library offers less, there is no watchdog, and rank 0 prints a
 * warning. */
#ifndef KILN_COORDINATOR_MPI_WATCHDOG_H
#define KILN_COORDINATOR_MPI_WATCHDOG_H

#include <mpi.h>

#include "worker/base/status.h"

struct kiln_watchdog;

/* Call it before MPI_Init. The process prints a message and ends with KILN_RANK_LOST if kiln_watchdog_create has not
 * returned within `seconds` (0: no deadline). */
void kiln_watchdog_start(int rank, double seconds);

/* Collective over `communicator`. `limit` is in seconds. If it is 0, or there is a single rank, *watchdog is NULL,
 * which all functions here accept. `halt` is for tests: this rank stops itself (SIGSTOP) when it enters the phase or
 * the blocking call of that name; NULL: it never does. Borrowed until the watchdog is destroyed. Destroy with
 * kiln_watchdog_destroy. */
int kiln_watchdog_create(struct kiln_watchdog **watchdog, MPI_Comm communicator, double limit, const char *halt,
                         struct kiln_error *error);
/* Collective. The watchdog still works while this call waits for the other ranks. After it, the process ends itself
 * with KILN_RANK_LOST if MPI_Finalize does not return within the limit. */
void kiln_watchdog_destroy(struct kiln_watchdog **watchdog);

/* This rank enters `phase` (copied) outside of a pass. It need not call the watchdog again for any time. */
void kiln_watchdog_phase(struct kiln_watchdog *watchdog, const char *phase);
/* This rank, within a pass, has finished a batch that took `seconds` and will finish another one soon. `progress` is
 * the fraction of the pass that is done, 0 to 1. */
void kiln_watchdog_batch(struct kiln_watchdog *watchdog, double progress, double seconds);
/* The pass is over or suspended. */
void kiln_watchdog_rest(struct kiln_watchdog *watchdog);
/* Sets a deadline for a blocking call that begins now: twice the limit plus `seconds`. `what`, a static string, names
 * the call. NULL: the call has returned. */
void kiln_watchdog_blocking(struct kiln_watchdog *watchdog, const char *what, double seconds);

#endif
