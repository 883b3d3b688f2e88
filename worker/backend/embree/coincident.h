/* Where a front and a back coincide, a ray meets the front (KILN_COINCIDENT in shaders/shared/surface.h).
 *
 * Where a hit is the back of a single-sided triangle, a search at its place finds the front that coincides with it. Few
 * triangles have such a partner anywhere. So a first search finds, once for each triangle whose back is met often,
 * whether one may be there: a triangle near it in a plane that is nearly the same and turned round. Planes at an angle
 * coincide at a line only, where rounding decides in any case. The first search of a large triangle meets most of the
 * scene; while few places of a triangle were met, it is made only where the other has found a front. Results are the
 * same. */
#ifndef KILN_WORKER_BACKEND_EMBREE_COINCIDENT_H
#define KILN_WORKER_BACKEND_EMBREE_COINCIDENT_H

#include "worker/backend/embree/passage.h"

/* Puts the front in the place of the back that a ray has met, where there is one. `valid`: -1 for a ray, 0 for none.
 * The backend's `coincides` is not NULL. From any thread. */
void embree_prefer_front1(const struct embree_backend *backend, const struct embree_context *context,
                          struct RTCRayHit *ray);
void embree_prefer_front8(const struct embree_backend *backend, const struct embree_context *context, const int *valid,
                          struct RTCRayHit8 *rays);

/* Whether a face coincides with what a ray of this direction has met: the back of a solid, or a front. The context asks
 * for solids (embree_context_solid). Needs no `coincides`: for rays that are few. From any thread. */
bool embree_coincides(const struct embree_backend *backend, const struct embree_context *context,
                      const struct RTCHit *hit, struct kiln_vec3 direction, bool back);

#endif
