/* Paths that begin at surface points, for the reference pass (worker/pass/reference.h): those of the path pass from
 * their second surface on. */
#ifndef KILN_WORKER_BACKEND_EMBREE_PATH_H
#define KILN_WORKER_BACKEND_EMBREE_PATH_H

#include "worker/backend/embree/walk.h"

/* Follows the path of a ray from a surface point on from what the ray has met, on a side of it that is there. `key` and
 * `k`: what the path's random numbers hang on, and the number of the sample. `bounces`: of
 * struct kiln_reference_parameters. `radiance`: what comes along the ray, W/(m2 sr), but for what the surface emits
 * that it has met; `last`: what of that has left `bounces` diffuse surfaces. The walk has choices; its rays are
 * counted, but for the one that is given. */
void path_follow(struct walk *walk, uint32_t key, uint32_t k, uint32_t bounces, const struct RTCRayHit *ray,
                 float radiance[3], float last[3]);

#endif
