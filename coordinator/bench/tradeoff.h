/* kiln bench tradeoff: bakes a scene with many settings, and measures error, time and memory of each against a
 * converged bake. What no other bake of the sweep beats in both error and time is the front: the settings worth
 * choosing from.
 *
 * The error of a bake is its nrmse: the root mean square of the difference of all light from the reference, over R, G,
 * B and the area of the surfaces, divided by the mean of the reference. It is taken from the lightmaps, as they are
 * published (denoised, seams smoothed), at the centres of the reference's texels; a bake of another density is read
 * there bilinearly, as an engine reads it. Texels that are buried in either are left out. The parts of direct and
 * indirect light are divided by the same mean. Time is that of the whole process, by the clock, without volume, preview
 * and export, and of its passes of light; processor time is that of all its threads, and memory the peak of the
 * process. */
#ifndef KILN_COORDINATOR_BENCH_TRADEOFF_H
#define KILN_COORDINATOR_BENCH_TRADEOFF_H

#include "coordinator/job/job.h"

/* Runs the bakes of the groups that are arguments 2, 3, ... of the job, or of all groups, on job->scene; an argument
 * such as 32,4,64 is a bake with so many samples of direct light, of the bounces and of the final gather. Bakes the
 * reference first, with job->reference_samples gather rays for each texel and another seed, unless job->reference names
 * one. Options of the job that bake also has are passed on to all bakes, but those that are swept are refused.
 *
 * Writes to job->output (default: the scene's name + "-tradeoff") after every bake: tradeoff.csv, tradeoff.svg (error
 * over time), and tradeoff.json, from which the same command goes on; the reference's bake stays there too. Prints the
 * front and what to choose to stdout, as JSON with job->json; progress to stderr. With job->list it only prints what
 * would run. Begins no further bake that would likely end after job->budget seconds. Call it before MPI is started,
 * from a process with one thread. KILN_USAGE, KILN_BAD_INPUT, KILN_STOPPED, or the status of a bake that failed. */
int kiln_tradeoff_bench(struct kiln_job *job, struct kiln_error *error);

#endif
