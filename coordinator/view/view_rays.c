#include "coordinator/view/view_rays.h"

#include "worker/backend/extended.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/backend/particle.h"

enum { MOST_BACK_FACES = 64 };

void kiln_view_ray(const struct kiln_view_params *params, double x, double y, struct kiln_vec3 *origin,
                   struct kiln_vec3 *direction)
{
    const struct kiln_view_camera *c = &params->camera;
    const double sx = x / params->width * 2.0 - 1.0, sy = 1.0 - y / params->height * 2.0;
    const struct kiln_dvec3 aside =
        dvec3_add(dvec3_scale(c->right, sx * c->extent_x), dvec3_scale(c->up, sy * c->extent_y));
    const struct kiln_dvec3 way = c->orthographic ? c->forward : dvec3_add(c->forward, aside);
    *origin = vec3_of(c->orthographic ? dvec3_add(c->position, aside) : c->position);
    *direction = vec3_of(dvec3_scale(way, 1.0 / dvec3_length(way)));
}

bool kiln_view_goes_on(const struct kiln_view_source *source, const struct kiln_hit *hit)
{
    return source->field == NULL && !source->texels && kiln_particle_turns(&source->backend->params, hit);
}

int kiln_view_rays_create(struct kiln_view_rays **rays, size_t capacity, struct kiln_error *error)
{
    int status = kiln_allocate(rays, 1, sizeof **rays, "rays of a view", error);
    if (status != KILN_OK)
        return status;
    struct kiln_view_rays *r = *rays;
    struct kiln_vec3 **vectors[] = {&r->origins, &r->directions, &r->active_origins, &r->active_directions};
    r->capacity = capacity;
    KILN_TRY(status);
    for (size_t i = 0; i < sizeof vectors / sizeof *vectors; i++)
        KILN_TRY(kiln_allocate(vectors[i], capacity, sizeof(struct kiln_vec3), "rays of a view", error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->hits, capacity, sizeof *r->hits, "hits of a view", error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->active_hits, capacity, sizeof *r->hits, "hits of a view", error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->active, capacity, sizeof *r->active, "rays of a view", error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->passed, capacity, sizeof *r->passed, "rays of a view", error));
end:
    if (status != KILN_OK)
        kiln_view_rays_destroy(rays);
    return status;
}

void kiln_view_rays_destroy(struct kiln_view_rays **rays)
{
    struct kiln_view_rays *r = *rays;
    if (r == NULL)
        return;
    kiln_free(&r->origins);
    kiln_free(&r->directions);
    kiln_free(&r->active_origins);
    kiln_free(&r->active_directions);
    kiln_arena_release(&r->arena);
    kiln_free(rays);
}

static bool is_unpublished(const struct kiln_scene *scene, uint32_t object)
{
    return (scene->objects[object].flags & KILN_OBJECT_CASTER_ONLY) != 0;
}

bool kiln_view_is_seen(const struct kiln_view_source *source, const struct kiln_hit *hit)
{
    if (hit->triangle == KILN_NONE)
        return false;
    const struct kiln_hit_record *record = &source->geometry->records[hit->triangle];
    if (is_unpublished(source->scene, record->object) && (record->material & KILN_RECORD_EMITS) == 0)
        return false;
    return !hit->back || (record->material & KILN_RECORD_DOUBLE_SIDED) != 0 || kiln_view_goes_on(source, hit);
}

/* Finds the rays that pass through a hidden back and continue. Writes their indices to `active`; returns their number.
 */
static size_t step_behind_backs(const struct kiln_view_source *source, struct kiln_view_rays *r, size_t count)
{
    const struct kiln_geometry *g = source->geometry;
    size_t active = 0;
    for (size_t i = 0; i < count; i++) {
        if (r->hits[i].triangle == KILN_NONE || kiln_view_is_seen(source, &r->hits[i]))
            continue;
        const float beyond = r->hits[i].distance * (1.0f + 1e-6f) + 1e-6f * g->extent;
        r->origins[i] = vec3_madd(r->origins[i], r->directions[i], beyond);
        r->passed[i] += beyond;
        r->active[active] = (uint32_t)i;
        r->active_origins[active] = r->origins[i];
        r->active_directions[active++] = r->directions[i];
    }
    return active;
}

/* Replaces the hit of a ray by its next one; the tint of glass before the old hit still applies. */
static void advance_hit(struct kiln_hit *hit, const struct kiln_hit *next)
{
    const float before[3] = {hit->tint[0], hit->tint[1], hit->tint[2]};
    *hit = *next;
    for (int c = 0; c < 3; c++)
        hit->tint[c] *= before[c];
}

int kiln_view_trace(const struct kiln_view_source *source, struct kiln_view_rays *r, size_t count,
                    struct kiln_error *error)
{
    int status = kiln_backend_intersect_hinted(source->backend, r->origins, r->directions, count,
                                               &(struct kiln_ray_hints){.alike = true}, r->hits, error);
    for (size_t i = 0; i < count; i++)
        r->passed[i] = 0.0f;
    for (int step = 0; status == KILN_OK && step < MOST_BACK_FACES; step++) {
        const size_t active = step_behind_backs(source, r, count);
        if (active == 0)
            break;
        status = kiln_backend_intersect(source->backend, r->active_origins, r->active_directions, active,
                                        r->active_hits, error);
        for (size_t i = 0; status == KILN_OK && i < active; i++)
            advance_hit(&r->hits[r->active[i]], &r->active_hits[i]);
    }
    return status;
}

int kiln_view_trace_pixels(const struct kiln_view_params *p, uint32_t side, struct kiln_view_rays *rays, size_t first,
                           size_t count, struct kiln_error *error)
{
    const size_t each = (size_t)side * side;
#pragma omp parallel for schedule(dynamic, 4096)
    for (size_t i = 0; i < count * each; i++) {
        const size_t pixel = first + i / each;
        kiln_view_ray(p, (double)(pixel % p->width) + ((double)(i % side) + 0.5) / side,
                      (double)(pixel / p->width) + ((double)(i % each / side) + 0.5) / side, &rays->origins[i],
                      &rays->directions[i]);
    }
    return kiln_view_trace(&p->source, rays, count * each, error);
}
