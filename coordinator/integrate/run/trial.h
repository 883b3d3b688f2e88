/* Trial before the first step of a bake: measures the cost of points and redistributes them accordingly.
 *
 * Ranks begin with equal numbers of points, which are unequal work, and direct light, the first step, is often most of
 * it. If the ranks are on several nodes, so that not all can help each other, each computes a few tile runs of every
 * stretch of its points, 1 in 64, measures the time and discards the answers. Then points are redistributed by the rule
 * used between steps (repartition.h). A resumed bake has no trial. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_TRIAL_H
#define KILN_COORDINATOR_INTEGRATE_RUN_TRIAL_H

#include "coordinator/integrate/company.h"

/* Collective, before `first` begins. Writes time and findings to the report. Does nothing if no trial is due.
 * KILN_SYSTEM. */
int kiln_trial_run(const struct kiln_integrate_params *params, struct kiln_solution *solution,
                   struct kiln_company *company, const struct kiln_step *first, struct kiln_error *error);

#endif
