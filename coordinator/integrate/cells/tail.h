/* The geometric tail of the lean schedule: what the bounces after the last one would bring, were each the one before
 * times the same ratio. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_TAIL_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_TAIL_H

#include "coordinator/integrate/integrator.h"

/* Collective, after a step whose number of bounces is not given. Adds up the groups' powers over ranks; `before` and
 * `total` of the ledger move on by one step. Gives kiln_step_report.tail_error: light that reaches a room through a
 * door comes later than elsewhere, and only there the last two bounces show it. Groups much darker than the mean count
 * for less. */
int kiln_tail_measure(const struct kiln_integration *integration, const struct kiln_step_reports *reports,
                      double *tail_error, struct kiln_error *error);

/* Notes in the report, after a step without a tail, what the steps that did not come would bring. */
void kiln_tail_note_left(struct kiln_integrate_report *report);

/* Adds the tail after the last step to the sum of the own points, and notes it in the report. */
void kiln_tail_add(const struct kiln_integration *integration);

#endif
