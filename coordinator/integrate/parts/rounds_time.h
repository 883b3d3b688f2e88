/* Rounds whose length a clock decides, or the user: --time, --max-time beside --target-error, and --rounds.
 *
 * The time of a round is foretold from the one before: steps that come again take as long for each sample of an
 * unfinished point. With --time the light must be done early enough for what follows it: params->after_light. What was
 * decided stands in the step reports, and so in checkpoints; --rounds repeats it without a clock. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_TIME_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_ROUNDS_TIME_H

#include "coordinator/integrate/integrate.h"

/* Collective, when a round is judged. Lowers the level of the next round until it is expected to end in time; if no
 * level would, there is no next round, and it returns true. With --rounds it sets the level that is given instead. */
bool kiln_round_fit(const struct kiln_integrate_params *params, const struct kiln_step_reports *steps,
                    struct kiln_round *round);

#endif
