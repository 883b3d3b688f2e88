/* When the points are distributed anew between ranks: the rule by which bakes (repartition.c) and their simulation
 * (plan/simulate_light.c) decide between two steps. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_REPARTITION_RULE_H
#define KILN_COORDINATOR_INTEGRATE_RUN_REPARTITION_RULE_H

#include "coordinator/integrate/integrator.h"

/* Part of a mean rank's work by which a bound may lie off to fall between two cells (objects). */
#define KILN_BOUND_SLACK 0.05

/* Two steps, between which it is decided: the one that is over, whose costs are known, and the one that comes; and what
 * comes from that one on, itself among it. */
struct kiln_repartition_steps {
    struct kiln_step last, next;
    struct kiln_outlook outlook;
};

/* Whether it is done at all: `keeps_points` where some rank's backend does (kiln_backend_info). */
bool kiln_repartition_is_allowed(enum kiln_rebalance mode, bool keeps_points);
/* Whether the last step says enough of those to come: another pass says little, and where more than one step comes a
 * step of their own pass is waited for. */
bool kiln_repartition_is_due(enum kiln_rebalance mode, const struct kiln_repartition_steps *steps);
/* Before the first step it is tried what points cost (trial.h): so many tile runs of a stretch of so many points. */
enum { KILN_TRIAL_STRETCH = 1 << 16, KILN_TRIAL_TILE_RUNS = 16 };
/* Whether it is, where not all ranks help each other: the step is one of direct light in full, and each rank has
 * `least` points or more. */
bool kiln_trial_is_due(enum kiln_rebalance mode, const struct kiln_step *first, uint64_t least);
/* Seconds in the steps to come, when `longest` was the work of the rank that had most (or of the mean rank of a node
 * whose ranks help each other) in the last one, and `mean` that of all. Negative where new bounds would hardly be more
 * even than these. */
double kiln_repartition_gain(const struct kiln_repartition_steps *steps, double longest, double mean);
/* Whether it is asked what moving would cost. */
bool kiln_repartition_is_asked(enum kiln_rebalance mode, double gain);
/* Seconds of a move in which the rank that gets most gets so many points of so many bytes. */
double kiln_repartition_cost(double points, double bytes);
bool kiln_repartition_pays(enum kiln_rebalance mode, double gain, double cost);

#endif
