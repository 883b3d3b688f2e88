/* kiln bench tracing-range: what gather rays that end at a range, and radiance probes behind it, cost and save, on a
 * user's own scene: Vandersanden 2023's experiment on the tracing range (section 4.3.2), with spacings and bases of
 * probes besides, and the error against the unbiased bake. */
#ifndef KILN_COORDINATOR_BENCH_RANGE_H
#define KILN_COORDINATOR_BENCH_RANGE_H

#include "coordinator/job/job.h"

/* Bakes job->scene with ranges of 0, 1/16, 1/8, 1/4 and 1/2 of the scene's longest side, or with those that are
 * arguments 2, 3, ... of the job, in metres: each with all three bases of probes that are 1/16 of that side apart, and
 * with harmonics that are 1/8 and 1/32 of it apart; and once without an end. The reference is a bake with the same
 * options and an infinite range: what differs from it is the bias, and the noise of those samples that probes answer.
 * Options of the job that bake also has are passed on.
 *
 * Writes to job->output (default: the scene's name + "-tracing-range") after every bake: tracing-range.csv,
 * tracing-range.svg (error of indirect light over the range), and tracing-range.json, from which the same command goes
 * on; the reference stays there too. Prints a table to stdout, as JSON with job->json; progress to stderr. With
 * job->list it only prints what would run. Begins no further bake that would likely end after job->budget seconds. Call
 * it before MPI is started, from a process with one thread. KILN_USAGE, KILN_BAD_INPUT, KILN_STOPPED, or the status of
 * a bake that failed. */
int kiln_tracing_range_bench(struct kiln_job *job, struct kiln_error *error);

#endif
