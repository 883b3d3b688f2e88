/* Error agreement: all ranks of a communicator learn the worst status of any rank and its error message. When one rank
 * has failed, no other continues or waits for it for ever. */
#ifndef KILN_COORDINATOR_MPI_AGREE_H
#define KILN_COORDINATOR_MPI_AGREE_H

#include <mpi.h>

#include "worker/base/status.h"

/* Collective over `communicator`. Each rank passes its own status, and its message in `error` when the status is not
 * KILN_OK. Every rank returns the worst (largest) status of all; if that is not KILN_OK, `error` receives the message
 * of the lowest rank with that status. Otherwise `error` is left alone. `error` may be NULL on any rank.
 *
 * Call it after every step that may fail on some ranks only, before the next collective call. When the ranks do not all
 * have the same status, and the failure is one of a single rank or host (memory, threads, files, devices; not usage or
 * input), the message gets the prefix "rank N on HOST: ". A failing MPI call inside gives KILN_RANK_LOST if the
 * communicator returns errors instead of aborting. */
int kiln_agree(MPI_Comm communicator, int status, struct kiln_error *error);

/* Not collective. Puts the prefix "rank N on HOST: " before the message if the failure is one of this rank or its host
 * and the message has no such prefix yet. For messages that another rank will print. */
void kiln_name_rank(int status, struct kiln_error *error);

/* Not collective; does not return. Prints the message with rank and host, and ends all ranks with the status
 * (MPI_Abort). For failures at points where other ranks already wait for messages of this rank. */
void kiln_end_all_ranks(int status, const struct kiln_error *error) __attribute__((noreturn));

#endif
