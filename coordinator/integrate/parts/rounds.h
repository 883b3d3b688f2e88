/* Rounds of a bake in parts that has a target error (parts.h): how many there are, and with how many samples.
 *
 * The error of a tile run is a root mean square over its points: of the standard error over the error allowed, which is
 * the target times the point's luminance or, if larger, a tenth of the mean luminance. A tile run with an error of at
 * most 1 is finished: later terminal steps leave it out, and its results change no more. Its light still takes part in
 * each solve, with the samples of direct light from the first round. Rounds end when at most 2.5 % of the points lie in
 * other tile runs.
 *
 * With an error of published light in place of a target (rounds_published.h), rounds end when 95 % of all points stay
 * below it. Each tile run takes as many of a round's samples as it needs, from their beginning on; its weights are by
 * the samples that it has had (parts.h). The next round has the least level at which the error is expected to be
 * reached. Where raw light is off by more than four times the error asked for, it is not denoised to know that.
 *
 * Sample counts go by levels: at level l a step has level_times(l) / 2 times the samples of the first round: 1, 1.5, 2,
 * 3, 4, 6, 8, ... times. With a target, all unfinished tile runs have the same level. The next round raises it to the
 * level that at most a tenth of their points are expected to need. This prediction lets a variance fall with the
 * samples to the power of 1.5, which is faster than usual (Mitchell, "Consequences of Stratified Sampling in Graphics",
 * SIGGRAPH 1996). So few points get more samples than they need, and a finished tile run's error lies within a level of
 * the target. Rounds take consecutive ranges of a Sobol' sequence.
 *
 * With an error of published light caustics have levels of their own, of whole multiples of the first round's samples
 * and light paths. They rise as far as the caustics' share of the error asks (part_caustics.h), at all points; a round
 * whose other samples do more for their cost has no caustics.
 *
 * Intermediate steps need not be as good as the final gather of few points: their samples are reduced by the fraction
 * of unfinished points. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/parts/round_levels.h"

/* Returns the round of the last of `count` reports; NULL: the first round. */
const struct kiln_round *kiln_round_of(const struct kiln_step_report *reports, size_t count);

/* Whether a round read from a checkpoint is valid. */
bool kiln_round_is_sane(const struct kiln_round *round);

/* A round between the levels of caustics. */
struct kiln_round kiln_round_of_caustics(const struct kiln_round *round);

/* Sets the number of samples of a step in a later round, and where they begin in the sample sequence. The round goes
 * from level round->from to level round->to. `own`: number of the part in the round. `counts`: whether the step counts
 * for the result. On entry the step has the samples of the first round. */
void kiln_round_share(const struct kiln_round *round, uint32_t own, bool counts, struct kiln_step *step);

/* Collective, after the last part of a round, whose report is the last. Writes the finished tile runs, the samples of
 * the others and the next round into the report and the sample fields. A clock may shorten the round (rounds_time.h).
 * `unit`: of exact sums of power, W. KILN_SYSTEM. */
int kiln_round_judge(const struct kiln_integrate_params *params, const struct kiln_rank_data *data, double unit,
                     struct kiln_step_reports *steps, struct kiln_error *error);

#endif
