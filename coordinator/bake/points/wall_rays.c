#include "coordinator/bake/points/wall_rays.h"

#include <math.h>

#include "worker/backend/extended.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/scene/texture.h"

static const float ON = 1e-5f; /* offset behind a hit that is no wall, as a fraction of the ray's length */
enum { ROUNDS = 64 };          /* most surfaces that are no walls that a ray passes */

void kiln_wall_rays_destroy(struct kiln_wall_rays *s) { kiln_arena_release(&s->arena); }

int kiln_wall_rays_create(struct kiln_wall_rays *s, size_t room, struct kiln_error *error)
{
    const char *what = "rays along texels";
    *s = (struct kiln_wall_rays){.room = room};
    int status;
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->origins, room, sizeof *s->origins, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->directions, room, sizeof *s->directions, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->lengths, room, sizeof *s->lengths, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->hits, room, sizeof *s->hits, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->meets, room, sizeof *s->meets, what, error));
end:
    if (status != KILN_OK)
        kiln_wall_rays_destroy(s);
    return status;
}

void kiln_wall_rays_set(struct kiln_wall_rays *s, size_t i, struct kiln_dvec3 from, struct kiln_dvec3 to)
{
    const struct kiln_dvec3 d = dvec3_sub(to, from);
    const double length = dvec3_length(d);
    s->origins[i] = vec3_of(from);
    s->directions[i] = length > 0.0 ? vec3_of(dvec3_scale(d, 1.0 / length)) : vec3(1.0f, 0.0f, 0.0f);
    s->lengths[i] = (float)length;
}

void kiln_wall_rays_set_none(struct kiln_wall_rays *s, size_t i)
{
    s->origins[i] = vec3(0.0f, 0.0f, 0.0f);
    s->directions[i] = vec3(1.0f, 0.0f, 0.0f);
    s->lengths[i] = 0.0f;
}

static bool is_met(const struct kiln_wall_rays *s, size_t i)
{
    return s->lengths[i] > 0.0f && s->hits[i].triangle != KILN_NONE && s->hits[i].distance < s->lengths[i];
}

static bool is_wall(const struct kiln_scene *scene, const struct kiln_geometry *g, const struct kiln_hit *hit)
{
    float b1, b2;
    if (hit->triangle < g->opaque_count)
        return true;
    kiln_geometry_stored_barycentrics(scene, g, hit->triangle, hit->u, hit->v, &b1, &b2);
    return kiln_surface_opacity(scene, &scene->meshes[scene->objects[g->records[hit->triangle].object].mesh],
                                g->stored_triangle[hit->triangle], b1, b2) >= 1.0f;
}

/* Rays that have hit something that is no wall, and go on behind it. */
struct rest {
    struct kiln_wall_rays at;
    size_t *of; /* the rays they are the rest of */
    float *begin;
    size_t count;
};

static void rest_destroy(struct rest *r)
{
    kiln_wall_rays_destroy(&r->at);
    kiln_free(&r->of);
    kiln_free(&r->begin);
}

static int rest_create(struct rest *r, size_t count, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_wall_rays_create(&r->at, count, error));
    KILN_TRY(kiln_allocate(&r->of, count, sizeof *r->of, "rays along texels", error));
    KILN_TRY(kiln_allocate(&r->begin, count, sizeof *r->begin, "rays along texels", error));
end:
    return status;
}

/* Adds the continuation of ray `of`, which begins behind its hit at distance `met`. */
static void go_on(struct rest *r, const struct kiln_wall_rays *s, size_t of, float met)
{
    const float begin = met + ON * s->lengths[of];
    const size_t i = r->count++;
    r->of[i] = of;
    r->begin[i] = begin;
    r->at.origins[i] = vec3_madd(s->origins[of], s->directions[of], begin);
    r->at.directions[i] = s->directions[of];
    r->at.lengths[i] = s->lengths[of] - begin;
}

/* Traces the continuations, and keeps those that again hit no wall. */
static int trace_rest(struct rest *r, struct kiln_wall_rays *s, const struct kiln_scene *scene,
                      const struct kiln_geometry *g, struct kiln_backend *backend, struct kiln_error *error)
{
    const size_t count = r->count;
    const struct kiln_ray_hints hints = {.lengths = r->at.lengths};
    const int status =
        kiln_backend_intersect_hinted(backend, r->at.origins, r->at.directions, count, &hints, r->at.hits, error);
    r->count = 0;
    for (size_t i = 0; i < count && status == KILN_OK; i++) {
        const size_t of = r->of[i];
        if (!is_met(&r->at, i))
            continue;
        const float met = r->begin[i] + r->at.hits[i].distance;
        s->hits[of] = r->at.hits[i];
        s->hits[of].distance = met;
        s->meets[of] = is_wall(scene, g, &s->hits[of]);
        if (!s->meets[of] && met + ON * s->lengths[of] < s->lengths[of])
            go_on(r, s, of, met);
    }
    return status;
}

int kiln_wall_rays_trace(struct kiln_wall_rays *s, const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                         struct kiln_backend *backend, size_t count, struct kiln_error *error)
{
    struct rest r = {0};
    size_t open = 0;
    const struct kiln_ray_hints hints = {.lengths = s->lengths};
    int status;
    KILN_TRY(kiln_backend_intersect_hinted(backend, s->origins, s->directions, count, &hints, s->hits, error));
    for (size_t i = 0; i < count; i++) {
        s->meets[i] = is_met(s, i) && is_wall(scene, geometry, &s->hits[i]);
        open += is_met(s, i) && !s->meets[i];
    }
    if (open > 0)
        KILN_TRY(rest_create(&r, open, error));
    for (size_t i = 0; i < count && open > 0; i++)
        if (is_met(s, i) && !s->meets[i])
            go_on(&r, s, i, s->hits[i].distance);
    for (int round = 0; round < ROUNDS && r.count > 0; round++)
        KILN_TRY(trace_rest(&r, s, scene, geometry, backend, error));
end:
    rest_destroy(&r);
    return status;
}

bool kiln_wall_rays_inside(const struct kiln_wall_rays *s, const struct kiln_geometry *geometry, size_t i)
{
    return s->meets[i] && s->hits[i].back && kiln_geometry_is_solid(geometry, s->hits[i].triangle);
}
