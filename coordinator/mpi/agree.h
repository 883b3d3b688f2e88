/* One answer for all ranks: no rank goes on, or waits for ever, when another has failed. */
#ifndef KILN_COORDINATOR_MPI_AGREE_H
#define KILN_COORDINATOR_MPI_AGREE_H

#include <mpi.h>

#include "worker/base/status.h"

/* Collective over `communicator`. Each rank brings its own status and, when that is not 0, its sentence. Every rank
 * returns the worst (largest) status and holds the sentence of the first rank that failed with it; 0 leaves `error`
 * alone. Call it after any step that may fail on some ranks only, before the next collective call. Unless all fail
 * alike, the sentence of a failure that is of the rank or its host (memory, threads, files, devices; not usage or
 * input) begins with "rank N on HOST: ". `error` may be NULL on any rank. A failing MPI call inside gives
 * KILN_RANK_LOST where the communicator returns errors instead of aborting. */
int kiln_agree(MPI_Comm communicator, int status, struct kiln_error *error);

/* Not collective. Lets the sentence of a failure that is the rank's or its host's own begin with "rank N on HOST: ",
 * once: for those that another rank passes on. */
void kiln_name_rank(int status, struct kiln_error *error);

/* Not collective, and does not return: for a failure where others already wait for this rank's messages. Says the
 * sentence, with rank and host, and ends all ranks with the status. */
void kiln_end_all_ranks(int status, const struct kiln_error *error) __attribute__((noreturn));

#endif
