/* Rule for redistributing the points among ranks between two steps; bakes (repartition.c) and their simulation
 * (plan/simulate_light.c) share it. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_REPARTITION_RULE_H
#define KILN_COORDINATOR_INTEGRATE_RUN_REPARTITION_RULE_H

#include "coordinator/integrate/integrator.h"

/* Largest shift of a bound so that it falls between two cells (objects): fraction of a mean rank's work. */
#define KILN_BOUND_SLACK 0.05

/* Input of the decision between two steps: the last step, whose costs are known, the next step, and the outlook on all
 * remaining steps including the next. */
struct kiln_repartition_steps {
    struct kiln_step last, next;
    struct kiln_outlook outlook;
};

/* Whether points may be redistributed at all. `keeps_points`: some rank's backend keeps points (kiln_backend_info). */
bool kiln_repartition_is_allowed(enum kiln_rebalance mode, bool keeps_points);
/* Whether the last step predicts the remaining ones. A step of another pass predicts little: unless only one step
 * remains, the decision waits for two steps of one pass. */
bool kiln_repartition_is_due(enum kiln_rebalance mode, const struct kiln_repartition_steps *steps);
/* The trial before the first step (trial.h) measures the costs of so many tile runs in each stretch of so many
 * points. */
enum { KILN_TRIAL_STRETCH = 1 << 16, KILN_TRIAL_TILE_RUNS = 16 };
/* Whether the trial is due, where not all ranks help each other: the step computes direct light in full, and each rank
 * has `least` points or more. */
bool kiln_trial_is_due(enum kiln_rebalance mode, const struct kiln_step *first, uint64_t least);
/* Seconds gained in the remaining steps. `longest`: work in the last step of the rank with the most (or of the mean
 * rank of such a node, if ranks help each other); `mean`: mean over all. Negative if new bounds would hardly be more
 * even. */
double kiln_repartition_gain(const struct kiln_repartition_steps *steps, double longest, double mean);
/* Whether the gain is large enough to compute the cost of moving. */
bool kiln_repartition_is_asked(enum kiln_rebalance mode, double gain);
/* Seconds for moving the points, if the rank that receives most receives `points` points of `bytes` bytes each. */
double kiln_repartition_cost(double points, double bytes);
bool kiln_repartition_pays(enum kiln_rebalance mode, double gain, double cost);

#endif
