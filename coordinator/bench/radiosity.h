/* kiln bench radiosity: light between patches by the measures of Kahl, "RTX Radiosity", 2023, chapter 6, on a user's
 * own scene: time of a pass and DFPR (coordinator/view/compare.h) of pure pairs, undersampling, subdivision, cached
 * visibility and directions at several sizes, and beside them what he does not have: the true error.
 *
 * A size N is a scene of about N x N texels, as his one lightmap of N x N pixels. All bakes are diffuse, have lamps as
 * patches, as his tool has, two bounces (--bounces), and are not denoised. Nothing is clamped, unless a row says so.
 * DFPR is against the pure bake of the same size, of 8 bits and all pixels, as his tool computes it. The true error
 * (nrmse, as in kiln bench tradeoff) is against a bake by paths at the largest size, with sampled lamps: what texels
 * blur is in it. A pass's time is that of one bounce, by the clock; processor time is that of the whole bake. */
#ifndef KILN_COORDINATOR_BENCH_RADIOSITY_H
#define KILN_COORDINATOR_BENCH_RADIOSITY_H

#include "coordinator/job/job.h"

/* Bakes job->scene at the sizes that are arguments 2, 3, ... of the job (default 16, 32, 64), each with all rows of the
 * bench, or those of the groups that are named there (pure, random, mipmap, ...) and the pure ones. The reference has
 * job->reference_samples paths a texel, 1024 unless given.
 *
 * Writes to job->output (default: the scene's name + "-radiosity") after every bake: radiosity.csv; his tables as
 * radiosity-table-6.1.csv and -6.2.csv; his figures as radiosity-figure-6.5.svg, -6.7, -6.10, -6.11, -6.12 (and .csv:
 * pure passes of other scenes, of the generators, at the largest size), -6.13, -6.14 (and .csv:
 * which texels one texel sees by rays and by voxels), -6.15, -6.16 and -6.18.svg;
 * radiosity.svg, error over time of all; pictures/, a view of each bake with one exposure (his
 * figures 6.6, 6.8, 6.9, 6.11 and 6.17); radiosity.html, all of it on a page; radiosity.json, from which the same
 * command goes on. Keeps the pure bakes there, and the reference. Prints a table to stdout, as JSON with job->json;
 * progress to stderr. With job->list it only prints what would run. Begins no further bake that would likely end after
 * job->budget seconds. Call it before MPI is started, from a process with one thread. KILN_USAGE, KILN_BAD_INPUT,
 * KILN_STOPPED, or the status of a bake that failed. */
int kiln_radiosity_bench(struct kiln_job *job, struct kiln_error *error);

#endif
