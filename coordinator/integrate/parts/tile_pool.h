/* Means of what tile runs tell of their noise, over a tile and the eight around it in its lightmap.
 *
 * A tile run that has missed rare light by chance looks both darker and better than it is. If its own noise alone said
 * how many samples it gets, it would keep what it has, while tile runs that have met more of that light would get
 * samples that correct them: light would come out too dark. In a room that is lit through the gap of a door it came out
 * 3 % too dark so, and 1 % with the means, no more than with equal samples everywhere. Neighbours have samples of their
 * own, so the mean tells little of one tile run's luck. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_TILE_POOL_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_TILE_POOL_H

#include "coordinator/integrate/integrate.h"

/* Collective. Replaces the `values` of the own tile runs by the means around them, weighted by `weights`; where those
 * are all 0, values stay. Values are from 0 to `most`, which is the same on all ranks; larger ones count as `most`. The
 * same for any ranks and threads. KILN_SYSTEM. */
int kiln_tile_pool(const struct kiln_integrate_params *params, const struct kiln_surface *surface, double most,
                   const uint32_t *weights, double *values, struct kiln_error *error);

#endif
