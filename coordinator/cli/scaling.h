/* kiln bench scaling: measures strong and weak scaling by baking the same scene with different numbers of ranks. */
#ifndef KILN_COORDINATOR_CLI_SCALING_H
#define KILN_COORDINATOR_CLI_SCALING_H

#include "coordinator/job/job.h"

/* Runs `mpirun -n R kiln bake` on job->scene.file (a scene or job file) for each R of job->bench.rank_counts. Strong
 * scaling repeats the same bake. Weak scaling raises the texel density by the square root of R, so that each rank has
 * as many points as one rank of the first bake. All runs have the same number of threads per rank: --threads, or else
 * the cores of the machine divided by the largest R. Options that bake also has are passed on; the environment is
 * inherited.
 *
 * Writes the bakes, scaling.csv and scaling.svg to job->output (default: the scene's name + "-scaling"), and prints a
 * table and a summary. Call it before MPI is started, from a process with one thread. SIGINT, SIGTERM and SIGHUP end
 * the running bake too, and then the bench with KILN_STOPPED. KILN_USAGE for a bad list of ranks; otherwise the status
 * of a bake that failed. */
int kiln_scaling_bench(struct kiln_job *job, struct kiln_error *error);

#endif
