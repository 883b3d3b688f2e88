/* Storing of the results of the steps of "cells" in the data of points. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_TAKE_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_TAKE_H

#include "coordinator/integrate/integrator.h"

/* kiln_integrator.take */
void kiln_cells_take(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                     const struct kiln_tile_run *tile_run, const void *results, struct kiln_tally *tally,
                     struct kiln_tile_run_tally *tile_run_tally);

/* Stores a point's result; for integrators whose steps have roles of "cells". `radiosity` is the radiosity that the
 * point then sends, W/m2. `counts`: the point's error is not small enough yet (kiln_part_changes). */
void kiln_cells_enter(const struct kiln_taking *taking, const struct kiln_rank_data *data, struct kiln_own_point own,
                      const struct kiln_point_mean *answer, const float radiosity[3], bool counts);

/* Adds a point's radiosity, W/m2, to that of the parts of the step's number (kiln_part_send), if later rounds read it.
 * `bit`: the point's place in its tile. */
void kiln_cells_send(const struct kiln_taking *taking, const struct kiln_rank_data *data, struct kiln_own_point own,
                     const struct kiln_tile_run *tile_run, uint32_t bit, const float radiosity[3], bool counts);
/* Adds a point's result to the tallies, for the same integrators. `sent`: as in struct kiln_ledger_point. */
void kiln_cells_tally(const struct kiln_taking *taking, const struct kiln_surface *surface, struct kiln_own_point own,
                      const struct kiln_point_mean *answer, const float albedo[3], const float *sent,
                      struct kiln_tally *tally, struct kiln_tile_run_tally *tile_run_tally);

/* Packs the sums of all own points, 8 bytes each, into `next`, from which the final gather reads. */
void kiln_cells_pack_sum(const struct kiln_rank_data *own);

#endif
