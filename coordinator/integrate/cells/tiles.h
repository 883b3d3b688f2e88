/* Sums over the tiles of all lightmaps, for decisions by tiles. Tile runs would not do: cells cut tiles into runs and
 * must not change a result. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_TILES_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_TILES_H

#include "coordinator/integrate/integrator.h"

/* Collective. Adds up each of `count` values over the ranks. */
void kiln_tiles_reduce(MPI_Comm communicator, const struct kiln_integrate_settings *settings, uint64_t *values,
                       uint64_t count);

/* Adds to the value of a tile; several threads may have runs of the tile. Thread-safe. */
static inline void kiln_tiles_add(uint64_t *value, uint64_t more)
{
#pragma omp atomic
    *value += more;
}

/* Collective. Computes the mean luminance over all valid points of `values`, 3 an own point, W/m2; with `areas`, one an
 * own point, the mean power, W. The same for any ranks. */
int kiln_tiles_mean(const struct kiln_integration *integration, const float *values, const float *areas, double *mean,
                    struct kiln_error *error);

#endif
