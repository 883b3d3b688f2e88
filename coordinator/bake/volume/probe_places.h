/* Places of probes: a probe that lies inside geometry is moved out of it, to the nearest place outside. There it finds
 * light that belongs to the places around it, where the inside of a wall has none. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_PROBE_PLACES_H
#define KILN_COORDINATOR_BAKE_VOLUME_PROBE_PLACES_H

#include "coordinator/field/result.h"

/* Finds the places of `count` probes. `positions`: those of the grid, m from the scene's centre; afterwards those
 * where light is to be gathered. A probe counts as inside geometry when of 26 rays around it a quarter meet a back
 * first (of a single-sided surface or of a solid, but not of what lets light through: kiln_geometry_is_solid). It is
 * moved along the ray that leaves geometry soonest, by up to `reach` on each axis, m; where it is then inside geometry
 * again, along the next one. `places` says how far, and KILN_PROBE_BURIED where no ray leads out. Adds the number of
 * rays to *rays. Not collective. A probe's result does not hang on the others. */
int kiln_probe_places_find(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                           struct kiln_vec3 *positions, size_t count, const double reach[3],
                           struct kiln_probe_place *places, uint64_t *rays, struct kiln_error *error);

#endif
