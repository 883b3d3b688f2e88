/* --order unshot: progressive refinement (Cohen, Chen, Wallace and Greenberg, "A Progressive Refinement Approach to
 * Fast Radiosity Image Generation", SIGGRAPH 1988; Kahl, "RTX Radiosity", 2023, section 2.8.5). The first step that
 * goes from patch to patch goes through all nodes, as in lockstep, and keeps how the rows of points are closed. Rounds
 * follow: in each the nodes with the most unshot power send it (senders.h), and all points gather that; what a point
 * has not sent is what it keeps for later rounds, in the place of the radiosity of a bounce.
 *
 * KILN_UNSHOT_ROUNDS rounds ask as many pairs as a bounce, and have the number of that bounce. They end after the given
 * number of bounces, or when the unshot power is the given share of all that is reflected, which the ledger has as left
 * over. */
#ifndef KILN_COORDINATOR_INTEGRATE_RADIOSITY_UNSHOT_H
#define KILN_COORDINATOR_INTEGRATE_RADIOSITY_UNSHOT_H

#include "coordinator/integrate/integrator.h"

/* Index into the roles of "radiosity", after those of "cells". */
enum { KILN_RADIOSITY_ROUND = 5 };

/* The round after reports[0 .. count), the first `before` of which are no rounds. False: there is none. */
bool kiln_unshot_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                      size_t count, size_t before, struct kiln_step *step);

/* kiln_integrator.begin_step and take, of a round. */
int kiln_unshot_begin(struct kiln_integration *integration, struct kiln_step_report *last,
                      const struct kiln_step *step);
void kiln_unshot_take(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                      const struct kiln_tile_run *tile_run, const struct kiln_point_result *results,
                      struct kiln_tally *tally, struct kiln_tile_run_tally *tile_run_tally);

/* The share of all reflected power that no step has sent yet; 0: none is reflected. */
double kiln_unshot_share(const struct kiln_step_report *reports, size_t count);

#endif
