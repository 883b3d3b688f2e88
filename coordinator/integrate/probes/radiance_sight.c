#include "coordinator/integrate/probes/radiance_sight.h"

#include <math.h>

#include "worker/base/arena.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"
#include "worker/scene/radiance_probes.h"

enum { AROUND = 16 }; /* rays that find how far a point's surroundings are */

/* Rays of a range of points. Those of point i are at each * i and following. */
struct sight {
    const struct kiln_sight_params *params;
    uint64_t first, count; /* own points */
    uint32_t each;         /* rays of a point: to its corners, or around it */
    uint32_t *near_probes; /* of all own points */
    struct kiln_vec3 *origins, *directions;
    float *distances; /* distance to the probe, m; below 0: no ray */
    float *nearest;   /* per point: distance to the nearest visible probe, m; INFINITY: none is visible */
    struct kiln_hit *hits;
    struct kiln_arena arena;
};

/* Random number for the place in a point that covers only a part of its texel. With two or three triangles of equal
 * area the place is not at a corner or a side, where a wall may stand. */
#define INSIDE 0.2917f

/* A place well within the point, off its surface, and the geometric normal there. */
static struct kiln_vec3 middle_of(const struct kiln_sight_params *p, const struct kiln_point_cursor *at,
                                  struct kiln_vec3 *normal)
{
    const struct kiln_scene *scene = p->backend->params.scene;
    const struct kiln_geometry *geometry = p->backend->params.geometry;
    struct kiln_footprint footprint;
    uint32_t triangle;
    float b1, b2;
    kiln_footprint_prepare(&footprint, scene, geometry, p->surface, at);
    const bool whole = footprint.kind == KILN_FOOTPRINT_WHOLE;
    kiln_footprint_sample(&footprint, whole ? 0.5f : INSIDE, 0.5f, &triangle, &b1, &b2);
    const struct kiln_vec3 front = kiln_triangle_exact_normal(scene, geometry, triangle);
    *normal = at->back ? vec3_scale(front, -1.0f) : front;
    return vec3_madd(kiln_triangle_position(geometry, triangle, b1, b2), *normal,
                     kiln_offset_distance(geometry, triangle, *normal));
}

typedef void (*point_rays)(const struct sight *s, const struct kiln_point_cursor *at);

static void make_all(const struct sight *s, size_t first, size_t end, point_rays make)
{
    const struct kiln_surface *surface = s->params->surface;
#pragma omp parallel for num_threads((int)s->params->threads) schedule(dynamic, 16)
    for (size_t f = first; f < end; f++) {
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        for (uint32_t i = 0; i < surface->tile_runs[f].count; i++, kiln_point_next(surface, &at))
            make(s, &at);
    }
}

/* ---- probes that a point sees ---- */

/* The ray from `place` to a corner of its cell; a probe below the surface gets none. */
static void make_ray(const struct sight *s, uint64_t ray, struct kiln_vec3 place, struct kiln_vec3 normal,
                     uint32_t cell, uint32_t corner)
{
    const struct kiln_probe_grid *grid = &s->params->probes->grid;
    const bool there = (kiln_probe_corners(*grid) >> corner & 1u) != 0;
    s->origins[ray] = place;
    s->directions[ray] = normal;
    s->distances[ray] = -1.0f;
    const uint32_t probe = there ? kiln_probe_at_corner(grid, cell, corner) : 0;
    if (!there || kiln_probe_is_off(s->params->probes, probe))
        return;
    const struct kiln_vec3 to = vec3_sub(s->params->probes->positions[probe], place);
    const float distance = vec3_length(to);
    if (!(distance > 0.0f) || !(vec3_dot(to, normal) > 0.0f))
        return;
    s->directions[ray] = vec3_scale(to, 1.0f / distance);
    s->distances[ray] = distance;
}

/* point_rays */
static void look_at_corners(const struct sight *s, const struct kiln_point_cursor *at)
{
    struct kiln_vec3 normal;
    const struct kiln_vec3 place = middle_of(s->params, at, &normal);
    const uint32_t cell = kiln_probe_cell(&s->params->probes->grid, place);
    s->near_probes[at->point.at] = cell << KILN_PROBE_CORNERS;
    for (uint32_t c = 0; c < KILN_PROBE_CORNERS; c++)
        make_ray(s, s->each * (at->point.at - s->first) + c, place, normal, cell, c);
}

/* Moves the rays that exist to the front. Returns their number. */
static uint64_t pack(const struct sight *s)
{
    uint64_t count = 0;
    for (uint64_t i = 0; i < s->each * s->count; i++)
        if (s->distances[i] >= 0.0f) {
            s->origins[count] = s->origins[i];
            s->directions[count++] = s->directions[i];
        }
    return count;
}

static void judge(const struct sight *s)
{
    const struct kiln_surface *surface = s->params->surface;
    const float clear = KILN_PROBE_CLEAR * s->params->probes->grid.spacing;
    uint64_t ray = 0;
    for (uint64_t i = 0; i < s->count; i++) {
        s->nearest[i] = INFINITY;
        for (uint32_t c = 0; c < KILN_PROBE_CORNERS; c++) {
            const float distance = s->distances[s->each * i + c];
            if (distance < 0.0f)
                continue;
            const struct kiln_hit *hit = &s->hits[ray++];
            const bool sees = hit->triangle == KILN_NONE || hit->distance > distance + clear;
            if (!sees || !kiln_point_valid(surface, (struct kiln_own_point){s->first + i}))
                continue;
            s->near_probes[s->first + i] |= 1u << c;
            s->nearest[i] = fminf(s->nearest[i], distance);
        }
    }
}

/* ---- test whether a point's surroundings are nearer than its probes ---- */

/* Whether the nearest visible probe is farther away than the point's rays reach. */
static bool is_doubtful(const struct sight *s, uint64_t i)
{
    return s->nearest[i] < INFINITY && s->nearest[i] > s->params->probes->grid.range;
}

/* point_rays */
static void look_around(const struct sight *s, const struct kiln_point_cursor *at)
{
    const uint64_t i = at->point.at - s->first;
    struct kiln_vec3 normal, t, b;
    const struct kiln_vec3 place = middle_of(s->params, at, &normal);
    kiln_basis(normal, &t, &b);
    for (uint32_t k = 0; k < AROUND; k++) {
        const struct kiln_dvec3 d =
            kiln_cosine_direction(kiln_unit_double(kiln_sobol(k, 0)), kiln_unit_double(kiln_sobol(k, 1)));
        s->origins[AROUND * i + k] = place;
        s->directions[AROUND * i + k] =
            vec3_madd(vec3_madd(vec3_scale(normal, (float)d.z), t, (float)d.x), b, (float)d.y);
        s->distances[AROUND * i + k] = is_doubtful(s, i) ? 0.0f : -1.0f;
    }
}

/* Removes the probes of points whose surroundings, by the harmonic mean of distances, are nearer than the probes. */
static void judge_surroundings(const struct sight *s)
{
    const struct kiln_hit *hit = s->hits;
    for (uint64_t i = 0; i < s->count; i++) {
        float sum = 0.0f;
        for (uint32_t k = 0; is_doubtful(s, i) && k < AROUND; k++, hit++)
            sum += hit->triangle == KILN_NONE ? 0.0f : 1.0f / hit->distance;
        if (sum * s->nearest[i] > (float)AROUND)
            s->near_probes[s->first + i] &= ~KILN_PROBE_SEEN;
    }
}

static void take_for_seen(const struct sight *s)
{
    for (uint64_t i = 0; i < s->count; i++)
        s->near_probes[s->first + i] |= kiln_probe_corners(s->params->probes->grid);
}

/* Makes `each` rays of each point of tile runs [first, end), and traces those that stand for something. */
static int trace(struct sight *s, size_t first, size_t end, uint32_t each, point_rays make, uint64_t *rays,
                 struct kiln_error *error)
{
    s->each = each;
    make_all(s, first, end, make);
    const uint64_t count = pack(s);
    *rays += count;
    return kiln_backend_intersect(s->params->backend, s->origins, s->directions, (size_t)count, s->hits, error);
}

int kiln_sight_find(const struct kiln_sight_params *params, size_t first, size_t end, uint32_t *near_probes,
                    uint64_t *rays, struct kiln_error *error)
{
    if (first >= end)
        return KILN_OK;
    const struct kiln_surface *surface = params->surface;
    struct sight s = {.params = params,
                      .first = kiln_own_of_global(surface, surface->tile_runs[first].first).at,
                      .count = kiln_tile_runs_points(&surface->tile_runs[first], &surface->tile_runs[end - 1]),
                      .near_probes = near_probes};
    const size_t room = AROUND * (size_t)s.count; /* more than corners */
    int status;
    KILN_TRY(kiln_arena_allocate(&s.arena, &s.origins, room, sizeof *s.origins, "rays to radiance probes", error));
    KILN_TRY(
        kiln_arena_allocate(&s.arena, &s.directions, room, sizeof *s.directions, "rays to radiance probes", error));
    KILN_TRY(kiln_arena_allocate(&s.arena, &s.distances, room, sizeof *s.distances, "rays to radiance probes", error));
    KILN_TRY(kiln_arena_allocate(&s.arena, &s.hits, room, sizeof *s.hits, "rays to radiance probes", error));
    KILN_TRY(kiln_arena_allocate(&s.arena, &s.nearest, (size_t)s.count, sizeof *s.nearest, "rays to radiance probes",
                                 error));
    KILN_TRY(trace(&s, first, end, KILN_PROBE_CORNERS, look_at_corners, rays, error));
    judge(&s);
    KILN_TRY(trace(&s, first, end, AROUND, look_around, rays, error));
    judge_surroundings(&s);
    if (params->all)
        take_for_seen(&s);
end:
    kiln_arena_release(&s.arena);
    return status;
}
