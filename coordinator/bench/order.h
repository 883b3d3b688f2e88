/* kiln bench cell-size and kiln bench per-object: what the order of work costs, on a user's own scene. These are
 * Vandersanden 2023's experiments on the size of radiance cells (section 4.3.1) and on gathering for each object
 * instead of each cell (4.3.4).
 *
 * Surface points stand in one order: by cell along a space-filling curve, then by object, then by tile run of a
 * lightmap. A rank computes its range of them in that order, so that rays which are traced one after the other begin
 * near each other. Also a single rank does so. Smaller cells keep those rays closer together, and cut tile runs, which
 * then have fewer points each. With --partition objects the order is by object, then by tile: neighbours in a lightmap
 * follow each other, also where they are far from each other in space.
 *
 * kiln's light hangs on neither, so the error against the unbiased bake must be 0. Every lightmap is compared with that
 * of the reference, bit by bit. The reference is a bake with the same options, automatic cells and --partition cells,
 * by one rank. */
#ifndef KILN_COORDINATOR_BENCH_ORDER_H
#define KILN_COORDINATOR_BENCH_ORDER_H

#include "coordinator/job/job.h"

/* Bakes job->scene with cells whose side is the automatic one, and with the sides that are arguments 2, 3, ... of the
 * job, in metres; the argument "auto", or no argument, adds 1/8, 1/4 ... 4, 8 times the automatic side. With --ranks
 * for each number of ranks, else without mpirun. Each bake is run job->repeats times, in turn with the others; times
 * are medians. Options of the job that bake also has are passed on.
 *
 * Writes to job->output (default: the scene's name + "-cell-size") after every run: cell-size.csv, cell-size.svg (time
 * of light over the side), and cell-size.json, from which the same command goes on; the reference stays there too.
 * Cache references and misses are counted where perf_event_open is permitted; else these columns are empty, and a
 * sentence says why. Prints a table and sentences to stdout, as JSON with job->json; progress to stderr. With job->list
 * it only prints what would run. Begins no further run that would likely end after job->budget seconds. Call it before
 * MPI is started, from a process with one thread. KILN_BUG if a bake has other bits; KILN_USAGE, KILN_BAD_INPUT,
 * KILN_STOPPED, or the status of a bake that failed. */
int kiln_cell_size_bench(struct kiln_job *job, struct kiln_error *error);
/* The same with --partition cells and --partition objects; files are called per-object. Takes no arguments but the
 * scene. */
int kiln_per_object_bench(struct kiln_job *job, struct kiln_error *error);

#endif
