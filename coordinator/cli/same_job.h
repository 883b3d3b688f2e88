/* Whether all ranks were started for the same thing: mpirun can give each a command of its own, nodes can have other
 * files or another build. */
#ifndef KILN_COORDINATOR_CLI_SAME_JOB_H
#define KILN_COORDINATOR_CLI_SAME_JOB_H

#include <mpi.h>

#include "coordinator/job/job.h"

/* Collective, the first thing after the job was read. KILN_USAGE on all ranks when they differ; the sentence names the
 * first rank that does, its host, in what, and both values. Compared with rank 0's are: the command and its arguments;
 * all its options, defaults too, but those that may well differ from node to node and change no light (--threads,
 * --device, --device-memory, --dispatch-time, --verbose); of a scene's file its name, size and 64 samples of its bytes;
 * kiln's version and executable; MPI's library. `job` NULL: only `command`, and the build. */
int kiln_same_job(MPI_Comm communicator, const char *command, const struct kiln_job *job, struct kiln_error *error);

#endif
