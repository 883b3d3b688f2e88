/* Places of probes: a probe inside geometry is moved to the nearest place outside. There it gathers the light of its
 * surroundings; inside a wall there is none. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_PROBE_PLACES_H
#define KILN_COORDINATOR_BAKE_VOLUME_PROBE_PLACES_H

#include "coordinator/field/result.h"

/* Finds the places of `count` probes. `positions`: on entry those of the grid, m from the scene's centre; on return
 * those where light is to be gathered. A probe is inside geometry if at least a quarter of 26 rays around it hit a back
 * first (of a single-sided surface or of a solid, but not of a surface that lets light through:
 * kiln_geometry_is_solid). It is moved along the ray that leaves geometry soonest, by up to `reach` on each axis, m; if
 * it is then inside geometry again, along the next ray. `places` has the distance, and KILN_PROBE_BURIED if no ray
 * leads out. Adds the number of rays to *rays. Not collective. The results of probes are independent of each other. */
int kiln_probe_places_find(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                           struct kiln_vec3 *positions, size_t count, const double reach[3],
                           struct kiln_probe_place *places, uint64_t *rays, struct kiln_error *error);

#endif
