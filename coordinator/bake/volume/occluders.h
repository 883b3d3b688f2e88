/* The occluders of a probe: planes of the surfaces around it, from which coordinator/output/volume_eval.h tells what
 * the probe sees. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_OCCLUDERS_H
#define KILN_COORDINATOR_BAKE_VOLUME_OCCLUDERS_H

#include "coordinator/field/result.h"

/* Unit vector of one of the KILN_OCCLUDER_DIRECTIONS directions, which is not the middle. */
struct kiln_dvec3 kiln_occluder_direction(int direction);

/* Computes the occluders of `count` probes: one ray in each of 26 directions, to the first surface. `positions`: m from
 * the scene's centre. Adds the number of rays to *rays. Not collective. A probe's result does not hang on the others.
 */
int kiln_occluders_find(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                        const struct kiln_vec3 *positions, size_t count, struct kiln_probe_occluders *occluders,
                        uint64_t *rays, struct kiln_error *error);

#endif
