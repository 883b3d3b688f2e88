/* Wall rays: rays of a given length that test whether a wall stands in their way. A wall is a surface that lets no
 * light through where the ray meets it; cut-out, blended and clear surfaces are not walls. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_WALL_RAYS_H
#define KILN_COORDINATOR_BAKE_POINTS_WALL_RAYS_H

#include "worker/backend/backend.h"
#include "worker/base/arena.h"

struct kiln_wall_rays {
    size_t room;                            /* of each array */
    struct kiln_vec3 *origins, *directions; /* m, relative to the scene's centre; unit vectors */
    float *lengths;                         /* m; 0: no ray */
    struct kiln_hit *hits;
    bool *meets; /* after kiln_wall_rays_trace: a wall is met; `hits` has the nearest */
    struct kiln_arena arena;
};

/* Allocates arrays for `room` rays, without values yet. KILN_SYSTEM. Destroy with kiln_wall_rays_destroy, which accepts
 * a struct of zeros. */
int kiln_wall_rays_create(struct kiln_wall_rays *rays, size_t room, struct kiln_error *error);
void kiln_wall_rays_destroy(struct kiln_wall_rays *rays);

/* Sets ray i from one place to another (m, relative to the scene's centre), or marks ray i as absent. Thread-safe for
 * different i. */
void kiln_wall_rays_set(struct kiln_wall_rays *rays, size_t i, struct kiln_dvec3 from, struct kiln_dvec3 to);
void kiln_wall_rays_set_none(struct kiln_wall_rays *rays, size_t i);

/* Finds the walls that the first `count` rays meet. The distance of a hit is from the ray's beginning, m. All other
 * arguments are borrowed; the backend is that of the geometry. Not collective. KILN_SYSTEM, and the backend's failures.
 */
int kiln_wall_rays_trace(struct kiln_wall_rays *rays, const struct kiln_scene *scene,
                         const struct kiln_geometry *geometry, struct kiln_backend *backend, size_t count,
                         struct kiln_error *error);

/* Whether ray i meets its wall from inside a solid. */
bool kiln_wall_rays_inside(const struct kiln_wall_rays *rays, const struct kiln_geometry *geometry, size_t i);

#endif
