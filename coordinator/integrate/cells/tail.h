/* The geometric tail of the lean schedule: an estimate of the light of all bounces after the last one, in which each
 * bounce is the one before times the same ratio. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_TAIL_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_TAIL_H

#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/integrator.h"

/* Collective, after a step of a bake without a given number of bounces. Adds up the powers of groups over ranks, and
 * advances `before` and `total` of the ledger by one step. Computes kiln_step_report.tail_error by groups: light that
 * reaches a room through a door arrives later than elsewhere, and the last two bounces show this only there. Groups
 * much darker than the mean have less weight. */
int kiln_tail_measure(const struct kiln_integration *integration, const struct kiln_step_reports *reports,
                      double *tail_error, struct kiln_error *error);

/* Notes in the report, after a step without a tail, the estimated light of the omitted steps. `first`:
 * kiln_cells_first. */
void kiln_tail_note_left(struct kiln_integrate_report *report, size_t first);

/* Adds the tail after the last step to the sum of the own points, and notes it in the report. */
void kiln_tail_add(const struct kiln_integration *integration);

/* The sum of q + q^2 + ... for each channel's ratio q, which is limited to KILN_TAIL_RATIO_MOST. */
void kiln_tail_factors(const struct kiln_tail_fit *fit, float factor[3]);

/* The radiosity of an own point in the last step reported, RGB, before it is overwritten by the next. */
void kiln_tail_last(const struct kiln_integration *integration, struct kiln_own_point point, float rgb[3]);

/* Adds `factor` times that radiosity to the sums of `count` own points. Thread-safe for different points. */
void kiln_tail_extend(const struct kiln_integration *integration, struct kiln_own_point first, uint64_t count,
                      const float factor[3]);

#endif
