/* kiln bench crossover: from how many simultaneous views on one bake costs less than path tracing each of them, at
 * equal error (Vandersanden 2023, section 4.4: users of one bake).
 *
 * Views are drawn from places in the scene (crossover_views.c), small, 128 x 72 pixels: from the bake's lightmaps, and
 * by path tracing with few and with many paths a pixel. Each is compared with the same view of very many paths of
 * another seed. The error is what a user sees of it: the root mean square, over all views, of the difference of t =
 * e L / (1 + e L), with luminance L and e = 0.18 / the view's geometric mean of L: white is 1. Where texels are smaller
 * than these pixels, their noise is less here than in a view of full size.
 *
 * The error of n paths is C n^-p, by what two numbers of paths have. The error of the reference itself, by the same
 * formula, is taken out of both errors by squares. At n paths, n = (C / error of the bake)^(1/p), both ways have the
 * same error. The time of a path-traced view at 1920 x 1080 is n times that number of pixels times the time of a path,
 * from the difference of the two runs; that of a view from lightmaps is measured at two sizes. So what scales is paths
 * and pixels, and neither import nor BVH is counted. The bake is the whole process. Then N views cost less from one
 * bake where bake + N view <= N path.
 *
 * Times are of the processor, over all threads, which other programs disturb least; with a GPU, and beside them, by the
 * clock. */
#ifndef KILN_COORDINATOR_BENCH_CROSSOVER_H
#define KILN_COORDINATOR_BENCH_CROSSOVER_H

#include "coordinator/job/job.h"

/* Bakes job->scene with the options of the job that bake also has, draws the views, and writes to job->output (default:
 * the scene's name + "-crossover"): crossover.csv, crossover.svg (time over the number of views), views.csv (a path of
 * cameras, which kiln view --path takes), the bake, and the views. Prints the result, as JSON with job->json; progress
 * to stderr. The reference has 1024 paths a pixel, or --reference-samples. Call it before MPI is started, from a
 * process with one thread. KILN_USAGE, KILN_BAD_INPUT, KILN_STOPPED, or the status of a command that failed. */
int kiln_crossover_bench(struct kiln_job *job, struct kiln_error *error);

#endif
