/* Tries what points cost before the first step of a bake, and distributes them by that.
 *
 * Ranks begin with equal numbers of points, which are not equal work, and direct light, the first step, is often most
 * of it. Where ranks are of several nodes, so that not all can help each other, each computes a few tile runs of every
 * stretch of its points, 1 in 64, takes the time and drops the answers; then the points are distributed anew by the
 * rule that holds between steps (repartition.h). Not in a bake that goes on from a checkpoint. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_TRIAL_H
#define KILN_COORDINATOR_INTEGRATE_RUN_TRIAL_H

#include "coordinator/integrate/company.h"

/* Collective, before `first` is begun. The report gets the time, and what was found. Where nothing is tried, nothing
 * happens. KILN_SYSTEM. */
int kiln_trial_run(const struct kiln_integrate_params *params, struct kiln_solution *solution,
                   struct kiln_company *company, const struct kiln_step *first, struct kiln_error *error);

#endif
