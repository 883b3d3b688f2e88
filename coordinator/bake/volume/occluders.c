#include "coordinator/bake/volume/occluders.h"

#include <math.h>
#include <string.h>

#include "worker/base/arena.h"

enum { TOGETHER = 4096, RAYS = KILN_OCCLUDER_DIRECTIONS - 1, MIDDLE = KILN_OCCLUDER_DIRECTIONS / 2 };

/* The rays of some probes. */
struct occluder_rays {
    struct kiln_vec3 *origins, *directions; /* RAYS each */
    struct kiln_hit *hits;
    struct kiln_arena arena;
};

static int direction_of_ray(int ray) { return ray < MIDDLE ? ray : ray + 1; }

struct kiln_dvec3 kiln_occluder_direction(int direction)
{
    const struct kiln_dvec3 d =
        dvec3((double)(direction % 3 - 1), (double)(direction / 3 % 3 - 1), (double)(direction / 9 - 1));
    return dvec3_scale(d, 1.0 / dvec3_length(d));
}

/* Computes the plane of the triangle that was hit, in the form of struct kiln_probe_occluders. */
static void plane_of(const struct kiln_geometry *g, struct kiln_vec3 position, const struct kiln_hit *hit,
                     struct kiln_dvec3 direction, float plane[3])
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, hit->triangle, corner);
    const struct kiln_dvec3 o = dvec3_of(corner[0]);
    struct kiln_dvec3 n = dvec3_cross(dvec3_sub(dvec3_of(corner[1]), o), dvec3_sub(dvec3_of(corner[2]), o));
    n = dvec3_scale(n, (dvec3_dot(n, direction) < 0.0 ? -1.0 : 1.0) / dvec3_length(n));
    const double nearest = KILN_OCCLUDER_NEAREST * (double)vec3_length(vec3_sub(g->bounds_max, g->bounds_min));
    const double away = fmax(dvec3_dot(n, dvec3_sub(o, dvec3_of(position))), fmax(nearest, 1e-30));
    plane[0] = (float)(n.x / away);
    plane[1] = (float)(n.y / away);
    plane[2] = (float)(n.z / away);
}

static int find_some(struct kiln_backend *backend, const struct kiln_geometry *g, const struct kiln_vec3 *positions,
                     size_t count, const struct occluder_rays *r, struct kiln_probe_occluders *occluders,
                     struct kiln_error *error)
{
    for (size_t i = 0; i < count * RAYS; i++) {
        const struct kiln_dvec3 d = kiln_occluder_direction(direction_of_ray((int)(i % RAYS)));
        r->origins[i] = positions[i / RAYS];
        r->directions[i] = vec3((float)d.x, (float)d.y, (float)d.z);
    }
    const int status = kiln_backend_intersect(backend, r->origins, r->directions, count * RAYS, r->hits, error);
    for (size_t i = 0; status == KILN_OK && i < count * RAYS; i++) {
        const int direction = direction_of_ray((int)(i % RAYS));
        if (r->hits[i].triangle != KILN_NONE)
            plane_of(g, positions[i / RAYS], &r->hits[i], kiln_occluder_direction(direction),
                     occluders[i / RAYS].planes[direction]);
    }
    return status;
}

int kiln_occluders_find(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                        const struct kiln_vec3 *positions, size_t count, struct kiln_probe_occluders *occluders,
                        uint64_t *rays, struct kiln_error *error)
{
    const size_t room = (count < TOGETHER ? count : TOGETHER) * RAYS;
    struct occluder_rays r = {0};
    int status = kiln_arena_allocate(&r.arena, &r.origins, room, sizeof *r.origins, "the probes' rays", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&r.arena, &r.directions, room, sizeof *r.directions, "the probes' rays", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&r.arena, &r.hits, room, sizeof *r.hits, "the probes' rays", error);
    for (size_t done = 0; status == KILN_OK && done < count; done += TOGETHER) {
        const size_t some = count - done < TOGETHER ? count - done : TOGETHER;
        memset(occluders + done, 0, some * sizeof *occluders);
        status = find_some(backend, geometry, positions + done, some, &r, occluders + done, error);
        *rays += some * RAYS;
    }
    kiln_arena_release(&r.arena);
    return status;
}
