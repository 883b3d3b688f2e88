/* Coincident faces: where a front and a back coincide, a ray meets the front (KILN_COINCIDENT in
 * shaders/shared/surface.h).
 *
 * If a hit is the back of a single-sided triangle, a local search at the hit finds a coincident front. Few triangles
 * have one. So a search of the whole triangle, once for each triangle whose back is hit often, finds whether there may
 * be one: a nearby triangle in nearly the same plane, facing the other way. Planes at an angle coincide only along a
 * line, where rounding decides in any case. For a large triangle the whole search covers most of the scene; while few
 * hits are on it, it is made only after a local search has found a front. Results are the same. */
#ifndef KILN_WORKER_BACKEND_EMBREE_COINCIDENT_H
#define KILN_WORKER_BACKEND_EMBREE_COINCIDENT_H

#include "worker/backend/embree/passage.h"

/* Replaces the back that a ray has hit by a coincident front, if there is one. `valid`: -1 for a ray, 0 for none. The
 * backend's `coincides` must not be NULL. Callable from any thread. */
void embree_prefer_front1(const struct embree_backend *backend, const struct embree_context *context,
                          struct RTCRayHit *ray);
void embree_prefer_front8(const struct embree_backend *backend, const struct embree_context *context, const int *valid,
                          struct RTCRayHit8 *rays);

/* Whether a face coincides with the hit of a ray of this direction; `back`: looks for the back of a solid, else for a
 * front. The context asks for solids (embree_context_solid). Needs no `coincides`: meant for few rays. Callable from
 * any thread. */
bool embree_coincides(const struct embree_backend *backend, const struct embree_context *context,
                      const struct RTCHit *hit, struct kiln_vec3 direction, bool back);

#endif
