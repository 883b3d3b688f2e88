#include "coordinator/bake/volume/probe_places.h"

#include <math.h>
#include <string.h>

#include "coordinator/bake/volume/occluders.h"
#include "worker/base/arena.h"

enum { TOGETHER = 1024, RAYS = KILN_OCCLUDER_DIRECTIONS - 1, BACKS = (RAYS + 3) / 4, TRIES = 8 };

/* Distance of a moved probe from geometry, as a part of the shortest reach. */
static const double CLEARANCE = 0.1;

/* A probe that has no place yet. */
struct homeless {
    size_t probe;
    struct kiln_vec3 grid; /* its place in the grid */
    /* vectors from the probe out of geometry, the shortest first, m */
    struct kiln_vec3 ways[RAYS];
    double lengths[RAYS];
    uint32_t way_count;
};

struct places_work {
    struct kiln_backend *backend;
    const struct kiln_geometry *geometry;
    const double *reach;
    struct kiln_vec3 *origins, *directions; /* RAYS each */
    struct kiln_hit *hits;
    struct homeless *homeless;
    struct kiln_arena arena;
};

static bool is_inside_out(const struct places_work *w, const struct kiln_hit *hit)
{
    return hit->triangle != KILN_NONE && hit->back && kiln_geometry_is_solid(w->geometry, hit->triangle);
}

static struct kiln_dvec3 ray_direction(size_t ray)
{
    return kiln_occluder_direction(ray < RAYS / 2 ? (int)ray : (int)ray + 1);
}

static int trace(const struct places_work *w, const struct kiln_vec3 *positions, size_t count, uint64_t *rays,
                 struct kiln_error *error)
{
    for (size_t i = 0; i < count * RAYS; i++) {
        const struct kiln_dvec3 d = ray_direction(i % RAYS);
        w->origins[i] = positions[i / RAYS];
        w->directions[i] = vec3((float)d.x, (float)d.y, (float)d.z);
    }
    *rays += count * RAYS;
    return kiln_backend_intersect(w->backend, w->origins, w->directions, count * RAYS, w->hits, error);
}

static bool lies_inside(const struct places_work *w, size_t i)
{
    uint32_t backs = 0;
    for (size_t ray = 0; ray < RAYS; ray++)
        backs += is_inside_out(w, &w->hits[i * RAYS + ray]) ? 1 : 0;
    return backs >= BACKS;
}

/* The ways out along the rays traced last that meet a back, as far as they are in reach. */
static void find_ways(const struct places_work *w, size_t i, struct homeless *h)
{
    const double clear = CLEARANCE * fmin(w->reach[0], fmin(w->reach[1], w->reach[2]));
    h->way_count = 0;
    for (size_t ray = 0; ray < RAYS; ray++) {
        const struct kiln_hit *hit = &w->hits[i * RAYS + ray];
        const struct kiln_dvec3 d = ray_direction(ray);
        const double length = (double)hit->distance + clear;
        if (!is_inside_out(w, hit) || fabs(d.x) * length > w->reach[0] || fabs(d.y) * length > w->reach[1] ||
            fabs(d.z) * length > w->reach[2])
            continue;
        uint32_t at = h->way_count++;
        for (; at > 0 && h->lengths[at - 1] > length; at--) {
            h->lengths[at] = h->lengths[at - 1];
            h->ways[at] = h->ways[at - 1];
        }
        h->lengths[at] = length;
        h->ways[at] = vec3((float)(d.x * length), (float)(d.y * length), (float)(d.z * length));
    }
}

/* Tries the next way out for each of the *count probes without a place. Probes that are outside there take the place;
 * *count receives the number of those left. */
static int try_ways(const struct places_work *w, uint32_t way, size_t *count, struct kiln_vec3 *positions,
                    struct kiln_probe_place *places, uint64_t *rays, struct kiln_error *error)
{
    struct kiln_vec3 tried[TOGETHER];
    size_t left = 0;
    for (size_t i = 0; i < *count; i++)
        if (way < w->homeless[i].way_count) {
            w->homeless[left] = w->homeless[i];
            tried[left] = vec3_add(w->homeless[left].grid, w->homeless[left].ways[way]);
            left++;
        }
    *count = left;
    const int status = trace(w, tried, left, rays, error);
    left = 0;
    for (size_t i = 0; status == KILN_OK && i < *count; i++) {
        const struct homeless *h = &w->homeless[i];
        if (lies_inside(w, i)) {
            w->homeless[left++] = *h;
            continue;
        }
        const struct kiln_vec3 offset = h->ways[way];
        places[h->probe] = (struct kiln_probe_place){{offset.x, offset.y, offset.z}, KILN_PROBE_MOVED};
        positions[h->probe] = tried[i];
    }
    *count = left;
    return status;
}

static int find_some(const struct places_work *w, struct kiln_vec3 *positions, size_t count,
                     struct kiln_probe_place *places, uint64_t *rays, struct kiln_error *error)
{
    size_t left = 0;
    int status;
    KILN_TRY(trace(w, positions, count, rays, error));
    for (size_t i = 0; i < count; i++) {
        places[i] = (struct kiln_probe_place){{0.0f, 0.0f, 0.0f}, KILN_PROBE_IN_PLACE};
        if (!lies_inside(w, i))
            continue;
        places[i].state = KILN_PROBE_BURIED;
        w->homeless[left] = (struct homeless){.probe = i, .grid = positions[i]};
        find_ways(w, i, &w->homeless[left++]);
    }
    for (uint32_t way = 0; left > 0 && way < TRIES; way++)
        KILN_TRY(try_ways(w, way, &left, positions, places, rays, error));
end:
    return status;
}

int kiln_probe_places_find(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                           struct kiln_vec3 *positions, size_t count, const double reach[3],
                           struct kiln_probe_place *places, uint64_t *rays, struct kiln_error *error)
{
    const size_t most = count < TOGETHER ? count : TOGETHER;
    struct places_work w = {.backend = backend, .geometry = geometry, .reach = reach};
    int status;
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.origins, most * RAYS, sizeof *w.origins, "the probes' rays", error));
    KILN_TRY(
        kiln_arena_allocate(&w.arena, &w.directions, most * RAYS, sizeof *w.directions, "the probes' rays", error));
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.hits, most * RAYS, sizeof *w.hits, "the probes' rays", error));
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.homeless, most, sizeof *w.homeless, "probes inside geometry", error));
    for (size_t done = 0; done < count; done += TOGETHER) {
        const size_t some = count - done < TOGETHER ? count - done : TOGETHER;
        KILN_TRY(find_some(&w, positions + done, some, places + done, rays, error));
    }
end:
    kiln_arena_release(&w.arena);
    return status;
}
