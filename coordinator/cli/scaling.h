/* kiln bench scaling: the same bake on more and more ranks. */
#ifndef KILN_COORDINATOR_CLI_SCALING_H
#define KILN_COORDINATOR_CLI_SCALING_H

#include "coordinator/job/job.h"

/* Bakes job->scene (or job file) with `mpirun -n R kiln bake` for each R of job->rank_counts: strong scaling (the same
 * bake) and weak scaling (lightmaps finer by the root of R, so that a rank has as many points as one rank of the first
 * bake). Threads of a rank stay the same: what --threads says, else the machine's cores over the most ranks. Options
 * that bake knows too go on to it; the environment is the caller's. Leaves the bakes, scaling.csv and scaling.svg in
 * job->output (default: SCENE's name, "-scaling" added) and prints a table and a sentence. Must run before MPI is
 * started, on the only thread. SIGINT, SIGTERM and SIGHUP end the bake under way too, and then the bench with
 * KILN_STOPPED. KILN_USAGE for a bad list; a bake's own failure otherwise. */
int kiln_scaling_bench(struct kiln_job *job, struct kiln_error *error);

#endif
