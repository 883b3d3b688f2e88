/* --order unshot: progressive refinement (Cohen, Chen, Wallace and Greenberg, "A Progressive Refinement Approach to
 * Fast Radiosity Image Generation", SIGGRAPH 1988; Kahl, "RTX Radiosity", 2023, section 2.8.5). The first step between
 * patches visits all nodes, as in lockstep, and stores how the rows of points are closed. In each round after it, the
 * nodes with the most unshot power send it (senders.h), and all points gather it. A point stores its unshot radiosity
 * for later rounds, in the place of the radiosity of a bounce.
 *
 * KILN_UNSHOT_ROUNDS rounds test as many pairs as one bounce, and have that bounce's number. Rounds end after the given
 * number of bounces, or when the unshot power falls to the given fraction of all reflected power. The ledger records
 * the rest as left over. */
#ifndef KILN_COORDINATOR_INTEGRATE_RADIOSITY_UNSHOT_H
#define KILN_COORDINATOR_INTEGRATE_RADIOSITY_UNSHOT_H

#include "coordinator/integrate/integrator.h"

/* Index into the roles of "radiosity", after those of "cells". */
enum { KILN_RADIOSITY_ROUND = 5 };

/* Finds the round after reports[0 .. count), the first `before` of which are not rounds. False: there is none. */
bool kiln_unshot_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                      size_t count, size_t before, struct kiln_step *step);

/* kiln_integrator.begin_step and kiln_integrator.take for a round. */
int kiln_unshot_begin(struct kiln_integration *integration, struct kiln_step_report *last,
                      const struct kiln_step *step);
void kiln_unshot_take(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                      const struct kiln_tile_run *tile_run, const struct kiln_point_result *results,
                      struct kiln_tally *tally, struct kiln_tile_run_tally *tile_run_tally);

/* Returns the unshot fraction of all reflected power; 0 if no power is reflected. */
double kiln_unshot_share(const struct kiln_step_report *reports, size_t count);

#endif
