/* kiln bench converge: how fast the error of a view falls, for all ways to compute its light.
 *
 * The view is drawn by every method of kiln view but lightmaps, each in a process of its own, with 1, 2, 4, ... paths a
 * pixel. Its time is that of computing the picture, as kiln view --json says: by the clock, without import and BVH. The
 * errors are those of kiln_compare_images (coordinator/view/compare.h) against a reference: a given view, or one by
 * path tracing with many paths. That one is the mean of two halves with seeds of their own. They differ by twice the
 * error of their mean, so the reference's own error is known: a method cannot be seen to come closer than that.
 * Path tracing finds no light that lamps without extent send by way of mirrors and glass. Methods that find it look
 * wrong against such a reference; give one of theirs then.
 *
 * Methods are held against each other by the PSNR of 8-bit pictures: at equal time, the longest that all have reached;
 * by what doubling the time gains at the end; by the time to 45 dB (Sun 2020 and Rodrigues 2021 plot these). Between
 * two views PSNR is linear in the logarithm of the time. */
#ifndef KILN_COORDINATOR_BENCH_CONVERGE_H
#define KILN_COORDINATOR_BENCH_CONVERGE_H

#include "coordinator/job/job.h"

/* Draws the views of job->scene, by the methods that the arguments after it name, or all, and writes to job->output
 * (default: the scene's name + "-converge"): converge.csv, converge.svg (error over time), the last view of each
 * method, and reference.exr unless job->reference is one. A method that refuses the scene or the backend has a row that
 * says so. Prints the result, as JSON with job->json; progress to stderr. Call it before MPI is started, from a process
 * with one thread. KILN_USAGE, KILN_BAD_INPUT, KILN_STOPPED, or the status of a command that failed. */
int kiln_converge_bench(struct kiln_job *job, struct kiln_error *error);

/* KILN_USAGE if an option was given that of all benches only converge has: which view it draws, and its materials. */
int kiln_converge_refuse_elsewhere(const struct kiln_job *job, struct kiln_error *error);

#endif
