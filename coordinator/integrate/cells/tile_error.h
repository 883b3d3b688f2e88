/* Error of the tail for single objects and tiles. A closed white place keeps its light for long. If it is small, the
 * powers of the scene and of its groups do not show that, and the scene's tail would cut off its light too soon.
 * Bounces go on until the means of objects are accurate enough: the sum of the tail's errors over an object's tiles,
 * relative to all light of the object. The tile with the largest error, a pocket that may keep its light for hundreds
 * of bounces, is reported with its object.
 *
 * Let q be the ratio of the scene's tail (struct kiln_tail_fit), r the ratio of a tile's radiosity to that of the
 * bounce before, and s the fraction of the last bounce in the tile's light so far. The tail adds s q / (1 - q) to the
 * tile, and the correct value is s r / (1 - r). s also estimates r: the last step of a geometric series with the ratio
 * r has the fraction s. Results of few samples are noisy, so both estimates are moved towards q by KILN_TILE_SIGMAS
 * times their errors, which follow from the spread of the radiosity over the tile's points (spread_of). r is then the
 * estimate nearer to q, or q if they lie on both sides of it. The uncertainty of q itself (kiln_tail_fit.error) is
 * added.
 *
 * A tile's own ratio is rarely known well enough. The ratio of an object's powers is, by its standard error over the
 * tiles; so the error of an object is the larger of that sum and of what this ratio says. A dark room, whose light
 * comes from a bright one through a gap, has little power and a ratio of its own; objects count by their points, not by
 * their light.
 *
 * An object's mean is that of its results: by area, and without backs that no file shows (kiln_map_is_result). The
 * insides of white solids whose triangles are double-sided keep their light for hundreds of bounces; light that escapes
 * from them shows in the fronts' light.
 *
 * Points much darker than the mean of all have less weight (KILN_LATE_DARK). The unit is the tile and not the tile run,
 * because cells cut tiles into runs and must not change a result. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_TILE_ERROR_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_TILE_ERROR_H

#include "coordinator/integrate/integrator.h"

#define KILN_TILE_SIGMAS 3.0

/* Collective, after a bounce of the lean schedule without a given number of bounces, while solution->radiosity is the
 * radiosity that the bounce has gathered. Computes the largest error, relative to all its light, that a tail after this
 * bounce would cause in an object. Only tiles that have not ended (late.h) have an error. The tile with the largest
 * error goes into the solution's report. The same for any ranks and cells. KILN_SYSTEM. */
int kiln_tile_error(const struct kiln_integration *integration, double *largest, struct kiln_error *error);

#endif
