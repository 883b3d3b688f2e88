/* Sums over the tiles of all lightmaps, for decisions by tiles. Tile runs would not do: cells cut tiles into runs and
 * must not change a result. */
#ifndef KILN_COORDINATOR_INTEGRATE_TILE_SUMS_H
#define KILN_COORDINATOR_INTEGRATE_TILE_SUMS_H

#include <mpi.h>
#include <stdint.h>

#include "coordinator/integrate/settings.h"

/* Collective. Adds up each of `count` values over the ranks. */
void kiln_tiles_reduce(MPI_Comm communicator, const struct kiln_integrate_settings *settings, uint64_t *values,
                       uint64_t count);

/* Adds to the value of a tile; several threads may have runs of the tile. Thread-safe. */
static inline void kiln_tiles_add(uint64_t *value, uint64_t more)
{
#pragma omp atomic
    *value += more;
}

#endif
