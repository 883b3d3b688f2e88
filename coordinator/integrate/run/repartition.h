/* Distributes the points anew between two steps, by what they have cost.
 *
 * Where the points of the last step have cost some ranks (or nodes, where ranks help each other) more time than others,
 * and the steps to come would gain more by it than it costs, the ranks' ranges of the global order get new bounds by
 * these costs, between cells (objects) where that is as good. Points and all that is known of them go to their new
 * owners. Times settle the bounds, so that these may differ from run to run; results do not. By itself this is done
 * only where no backend keeps points: a device would have to be given all its points again, and the time of its first
 * batches says more about kernels being made than about points. There ranks of a host help each other (batches.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_REPARTITION_H
#define KILN_COORDINATOR_INTEGRATE_RUN_REPARTITION_H

#include "coordinator/integrate/company.h"

/* Collective, before `next` is begun. The solution's last report gets the time, and what was found. Changes the own
 * points of solution and surface. KILN_SYSTEM. */
int kiln_repartition(const struct kiln_integrate_params *params, struct kiln_solution *solution,
                     struct kiln_company *company, const struct kiln_step *next, struct kiln_error *error);

/* Collective, before the first step is begun; own->cost has what the points would take in it. `balance` gets what was
 * found and done. KILN_SYSTEM. */
int kiln_repartition_by_trial(const struct kiln_integrate_params *params, struct kiln_solution *solution,
                              struct kiln_company *company, const struct kiln_step *first,
                              struct kiln_step_balance *balance, struct kiln_error *error);

#endif
