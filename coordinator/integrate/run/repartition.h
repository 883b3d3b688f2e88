/* Redistributes the points among ranks between two steps, by their measured costs.
 *
 * A redistribution happens if the last step took some ranks (or nodes, where ranks help each other) longer than others,
 * and the remaining steps would save more time than it costs. The ranks' ranges of the global order then get new bounds
 * by these costs, between cells (objects) where that is as even. Points move to their new owners with all their data.
 * The bounds depend on times and may differ from run to run; results do not. In automatic mode this happens only if no
 * backend keeps points: a device would have to load all its points again, and its first batches measure the compilation
 * of kernels rather than the points. With devices, the ranks of a host help each other instead (batches.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_REPARTITION_H
#define KILN_COORDINATOR_INTEGRATE_RUN_REPARTITION_H

#include "coordinator/integrate/company.h"

/* Collective, before `next` begins. Writes time and findings to the solution's last report. Changes the own points of
 * solution and surface. KILN_SYSTEM. */
int kiln_repartition(const struct kiln_integrate_params *params, struct kiln_solution *solution,
                     struct kiln_company *company, const struct kiln_step *next, struct kiln_error *error);

/* Collective, before the first step begins. Redistributes by own->cost, the expected costs of the points in that step.
 * Writes findings and actions to `balance`. KILN_SYSTEM. */
int kiln_repartition_by_trial(const struct kiln_integrate_params *params, struct kiln_solution *solution,
                              struct kiln_company *company, const struct kiln_step *first,
                              struct kiln_step_balance *balance, struct kiln_error *error);

#endif
