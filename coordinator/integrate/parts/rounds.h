/* Rounds of a bake in parts that has a target error (parts.h): how many there are, and with how many samples.
 *
 * A tile run's error is the root mean square, over its points, of the standard error over what is allowed there: the
 * target times the point's luminance, or times a tenth of the mean luminance where that is more. A tile run whose error
 * is 1 at most is finished: it is left out of terminal steps from then on, and its results change no more; its light is
 * still part of each solve, with the samples of direct light that it had in the first round. Rounds end when 2.5 % of
 * the points at most lie in other tile runs.
 *
 * How much light is known of a tile run goes by levels: with level l, a step's samples are level_times(l) / 2 times
 * those of the first round: 1, 1.5, 2, 3, 4, 6, 8, ... times. All tile runs that are not finished have the same level.
 * The next round takes them to the level that a tenth of their points is expected to need at most, if a variance falls
 * with the samples to the power of 1.5, which is more than most do (Mitchell, "Consequences of Stratified Sampling in
 * Graphics", SIGGRAPH 1996): so few have more samples than they need, and a finished tile run's error lies within a
 * level of the target. The stretches of a Sobol' sequence that rounds take follow one another.
 *
 * Steps that others gather from need not be as good as the final gather of few points: their samples are fewer by the
 * share of points that is not finished. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_H

#include "coordinator/integrate/integrate.h"

/* The round that the last of `count` reports is of; NULL: the first. */
const struct kiln_round *kiln_round_of(const struct kiln_step_report *reports, size_t count);

/* Whether a round that was read from a checkpoint can be one. */
bool kiln_round_is_sane(const struct kiln_round *round);

/* The samples of a step in a part of the first round, of `samples` in the settings: a quarter of a part's share, even,
 * and 2 at least, as far as the result has them; of what only others gather from, one at least. */
uint32_t kiln_round_first(uint32_t samples, bool counts);

/* The step, which is one of part `own` of a round that goes from level to level, and has samples of the first round:
 * gets its samples, and which ones of the sequence they are. */
void kiln_round_share(const struct kiln_round *round, uint32_t own, bool counts, struct kiln_step *step);

/* Collective, after the last part of a round, whose report is the last. Which tile runs are finished, the samples of
 * the others, and the next round: into the report, and the fields of samples. With --max-time, a round that is expected
 * to end in time. `unit` is that of exact sums of power, W. KILN_SYSTEM. */
int kiln_round_judge(const struct kiln_integrate_params *params, const struct kiln_rank_data *data, double unit,
                     struct kiln_step_reports *steps, struct kiln_error *error);

#endif
