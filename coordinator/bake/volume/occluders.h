/* The occluders of a probe: planes of the surfaces around it. coordinator/output/volume_eval.h derives from them what
 * the probe sees. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_OCCLUDERS_H
#define KILN_COORDINATOR_BAKE_VOLUME_OCCLUDERS_H

#include "coordinator/field/result.h"

/* Unit vector of a direction, one of KILN_OCCLUDER_DIRECTIONS other than the middle. */
struct kiln_dvec3 kiln_occluder_direction(int direction);

/* Computes the occluders of `count` probes: one ray in each of 26 directions, to the first surface. `positions`: m from
 * the scene's centre. Adds the number of rays to *rays. Not collective. The results of probes are independent of each
 * other. */
int kiln_occluders_find(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                        const struct kiln_vec3 *positions, size_t count, struct kiln_probe_occluders *occluders,
                        uint64_t *rays, struct kiln_error *error);

#endif
