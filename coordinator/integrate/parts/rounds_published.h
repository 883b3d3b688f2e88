/* Judgement of a round by the error of published light (published.h, rounds.h).
 *
 * A tile run needs samples until twice its standard error is at most 0.8 of the error asked for: so many times what it
 * has had as its squared error is over that. A finished tile run is judged again after each round, and may need more:
 * the gain from denoising is better known then, and its neighbours' light has changed. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_PUBLISHED_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_PUBLISHED_H

#include "coordinator/integrate/parts/part_caustics.h"

/* Collective, after the last part of a round, of which `part` has the reports. Counts the round's samples into the
 * field samples_taken. Writes what each tile run needs into the field `samples`, in halves of the samples of the first
 * round; chooses round->to (0: there is no further round) and round->share; adds to the need of caustics. *reached: the
 * error; *texel_loss: parts/texel_loss.h; *foretold: all rounds that follow, on rank 0. KILN_SYSTEM. */
int kiln_round_judge_published(const struct kiln_integrate_params *params, const struct kiln_rank_data *data,
                               const struct kiln_step_reports *part, double unit, struct kiln_round *round,
                               double *reached, double *texel_loss, struct kiln_caustics_need *caustics,
                               struct kiln_foretold *foretold, struct kiln_error *error);

#endif
