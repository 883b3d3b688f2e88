#include "coordinator/integrate/radiance_sight.h"

#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

/* Rays of a range of points: of the point at place i those to its corners are at KILN_PROBE_CORNERS * i, and so on. */
struct sight {
    const struct kiln_sight_params *params;
    uint64_t first, count; /* own points */
    uint32_t *near_probes; /* of all own points */
    struct kiln_vec3 *origins, *directions;
    float *distances; /* m to the probe; below 0: the ray stands for nothing */
    struct kiln_hit *hits;
};

/* Of a point that is not the whole of its texel, by which numbers the place is drawn: not such as lie, for two
 * triangles of equal area or three, at a corner or a side, which may be a wall's foot. */
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

static void make_rays(const struct sight *s, size_t first, size_t end)
{
    const struct kiln_surface *surface = s->params->surface;
    const struct kiln_probe_grid *grid = &s->params->probes->grid;
#pragma omp parallel for num_threads((int)s->params->threads) schedule(dynamic, 16)
    for (size_t f = first; f < end; f++) {
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        for (uint32_t i = 0; i < surface->tile_runs[f].count; i++, kiln_point_next(surface, &at)) {
            struct kiln_vec3 normal;
            const struct kiln_vec3 place = middle_of(s->params, &at, &normal);
            const uint32_t cell = kiln_probe_cell(grid, place);
            s->near_probes[at.point.at] = cell << KILN_PROBE_CORNERS;
            for (uint32_t c = 0; c < KILN_PROBE_CORNERS; c++)
                make_ray(s, KILN_PROBE_CORNERS * (at.point.at - s->first) + c, place, normal, cell, c);
        }
    }
}

/* Brings those rays that stand for something to the front. Returns how many there are. */
static uint64_t pack(const struct sight *s)
{
    uint64_t count = 0;
    for (uint64_t i = 0; i < KILN_PROBE_CORNERS * s->count; i++)
        if (s->distances[i] >= 0.0f) {
            s->origins[count] = s->origins[i];
            s->directions[count++] = s->directions[i];
        }
    return count;
}

static void take_for_seen(const struct sight *s)
{
    for (uint64_t i = 0; i < s->count; i++)
        s->near_probes[s->first + i] |= kiln_probe_corners(s->params->probes->grid);
}

static void judge(const struct sight *s)
{
    const struct kiln_surface *surface = s->params->surface;
    const float clear = KILN_PROBE_CLEAR * s->params->probes->grid.spacing;
    uint64_t ray = 0;
    for (uint64_t i = 0; i < s->count; i++)
        for (uint32_t c = 0; c < KILN_PROBE_CORNERS; c++) {
            const float distance = s->distances[KILN_PROBE_CORNERS * i + c];
            if (distance < 0.0f)
                continue;
            const struct kiln_hit *hit = &s->hits[ray++];
            const bool sees = hit->triangle == KILN_NONE || hit->distance > distance + clear;
            if (sees && kiln_point_valid(surface, (struct kiln_own_point){s->first + i}))
                s->near_probes[s->first + i] |= 1u << c;
        }
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
    const size_t room = KILN_PROBE_CORNERS * (size_t)s.count;
    int status = kiln_allocate(&s.origins, room, sizeof *s.origins, "rays to radiance probes", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s.directions, room, sizeof *s.directions, "rays to radiance probes", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s.distances, room, sizeof *s.distances, "rays to radiance probes", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s.hits, room, sizeof *s.hits, "rays to radiance probes", error);
    if (status == KILN_OK) {
        make_rays(&s, first, end);
        const uint64_t count = pack(&s);
        status = kiln_backend_intersect(params->backend, s.origins, s.directions, (size_t)count, s.hits, error);
        *rays += count;
    }
    if (status == KILN_OK)
        judge(&s);
    if (status == KILN_OK && params->all)
        take_for_seen(&s);
    kiln_free(&s.origins);
    kiln_free(&s.directions);
    kiln_free(&s.distances);
    kiln_free(&s.hits);
    return status;
}
