/* What "cells" does with the answers of its steps. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_TAKE_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_TAKE_H

#include "coordinator/integrate/integrator.h"

/* kiln_integrator.take */
void kiln_cells_take(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                     const struct kiln_tile_run *tile_run, const void *results, struct kiln_tally *tally,
                     struct kiln_tile_run_tally *tile_run_tally);

/* Packs the sums of all own points, 8 bytes each, into `next`: what the final gather reads. */
void kiln_cells_pack_sum(const struct kiln_rank_data *own);

#endif
