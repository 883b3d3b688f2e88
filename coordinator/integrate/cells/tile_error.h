/* How well a tail fits single objects, and tiles. A closed white place keeps its light for long; where it is small, the
 * powers of the scene and of its groups do not show that, and the scene's tail would end its light too soon. Bounces go
 * on until the means of objects are good enough: what the tail misses of each tile's light, summed up, over all light
 * of the object. The tile that is off by the most, a pocket that may keep its light for hundreds of bounces, is
 * reported with its object.
 *
 * With the ratio q of the scene's tail (struct kiln_tail_fit), the ratio r of a tile's radiosity to what it was a
 * bounce before, and the share s of the last bounce in what the tile has had so far, the tail gives the tile
 * s q / (1 - q), and it would get s r / (1 - r). The share says much of r too: the last step of a geometric
 * series with the ratio r has the share s. The answers of few samples are rough: both are taken for nearer to q by
 * KILN_TILE_SIGMAS times their errors, which the spread of the radiosity over the tile's points shows (spread_of), and
 * r is the one nearer to q, or q where they lie on both sides of it. What is not known of q itself
 * (kiln_tail_fit.error) is added.
 *
 * An object's mean is that of its results: by area, and without backs that no file shows (kiln_map_is_result). The
 * insides of white solids whose triangles are double-sided keep their light for hundreds of bounces, and what gets out
 * of them shows in the fronts' light.
 *
 * Points much darker than the mean of all count for less (KILN_LATE_DARK). Tiles and not tile runs, because cells cut
 * tiles into runs and must not change a result. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_TILE_ERROR_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_TILE_ERROR_H

#include "coordinator/integrate/integrator.h"

#define KILN_TILE_SIGMAS 3.0

/* Collective, after a bounce of the lean schedule whose number of bounces is not given, while solution->radiosity is
 * what it has gathered from. The largest error of an object's light, relative to all its light, that a tail after this
 * bounce would make; of tiles that have not ended (late.h), the others have none. Those of the tile that is off by the
 * most go into the solution's report. The same for any ranks and cells. KILN_SYSTEM. */
int kiln_tile_error(const struct kiln_integration *integration, double *largest, struct kiln_error *error);

#endif
