/* Job comparison: checks that all ranks were started with the same command, files and program. mpirun can give each
 * rank a different command, and nodes can have different files or another build of kiln. */
#ifndef KILN_COORDINATOR_CLI_SAME_JOB_H
#define KILN_COORDINATOR_CLI_SAME_JOB_H

#include <mpi.h>

#include "coordinator/job/job.h"

/* Collective; to be called right after the job has been read. Returns KILN_USAGE on all ranks if a rank differs from
 * rank 0. The message names the first such rank, its host, the difference and both values. Compared are: the command
 * and its arguments; all options, including defaults, except those that may differ from node to node and do not affect
 * the light (--threads, --device, --device-memory, --kernel-cache, --verbose); KILN_EXCHANGE_LIMIT (job/faults.h);
 * name, size and 64 samples of the bytes of the scene file; version and executable of kiln; the MPI library. With `job`
 * NULL, only `command` and the build are compared. */
int kiln_same_job(MPI_Comm communicator, const char *command, const struct kiln_job *job, struct kiln_error *error);

#endif
