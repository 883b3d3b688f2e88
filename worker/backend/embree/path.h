/* Paths from surface points, for the reference pass (worker/pass/reference.h): like those of the path pass from their
 * second surface on. */
#ifndef KILN_WORKER_BACKEND_EMBREE_PATH_H
#define KILN_WORKER_BACKEND_EMBREE_PATH_H

#include "worker/backend/embree/walk.h"

/* Continues a path from a surface point at its first ray's hit, on a side with a surface. `key` and `k`: key of the
 * path's random numbers, and number of the sample. `bounces`: of struct kiln_reference_parameters. `radiance`: radiance
 * along the ray, W/(m2 sr), without the emission of the surface that it hit; `last`: the part of it that was scattered
 * by `bounces` diffuse surfaces. The walk has choices. Its rays are counted, except the given one. */
void path_follow(struct walk *walk, uint32_t key, uint32_t k, uint32_t bounces, const struct RTCRayHit *ray,
                 float radiance[3], float last[3]);

#endif
