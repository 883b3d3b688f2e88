#include "coordinator/integrate/run/repartition_rule.h"

#define LEFT_UNEVEN 0.05 /* imbalance expected with new bounds, relative to the mean */
#define LEAST_GAIN 0.1   /* least gain for which the cost of a move is considered, s */
#define PAYS 2.0         /* a move must gain so many times its cost */
#define MOVE_BYTES 300e6 /* bytes per second and rank: packing, sending and unpacking */
#define MOVE_START 0.02  /* s */

bool kiln_repartition_is_allowed(enum kiln_rebalance mode, bool keeps_points)
{
    return mode == KILN_REBALANCE_ALWAYS || (mode == KILN_REBALANCE_AUTO && !keeps_points);
}

bool kiln_repartition_is_due(enum kiln_rebalance mode, const struct kiln_repartition_steps *steps)
{
    return mode == KILN_REBALANCE_ALWAYS || steps->last.pass == steps->next.pass || steps->outlook.steps == 1;
}

bool kiln_trial_is_due(enum kiln_rebalance mode, const struct kiln_step *first, uint64_t least)
{
    return first->pass == &kiln_pass_direct && first->counted && first->samples_field == NULL && first->with == 0 &&
           (mode == KILN_REBALANCE_ALWAYS || least >= KILN_TRIAL_STRETCH);
}

double kiln_repartition_gain(const struct kiln_repartition_steps *steps, double longest, double mean)
{
    return steps->outlook.samples / (double)steps->last.samples * (longest - (1.0 + LEFT_UNEVEN) * mean);
}

bool kiln_repartition_is_asked(enum kiln_rebalance mode, double gain)
{
    return mode == KILN_REBALANCE_ALWAYS || gain > LEAST_GAIN;
}

double kiln_repartition_cost(double points, double bytes) { return MOVE_START + points * bytes / MOVE_BYTES; }

bool kiln_repartition_pays(enum kiln_rebalance mode, double gain, double cost)
{
    return mode == KILN_REBALANCE_ALWAYS || gain > PAYS * cost;
}
