/* The stage "walls": parts of an object's surface that walls separate stay separate in its lightmap, too.
 *
 * Walls stand on divided texels (struct kiln_divided_texel of worker/scene/surface.h). Texels of a lightmap belong to
 * one region if a path leads from one to the other, from texel to texel, that no wall crosses. Regions that a wall
 * separates do not fill each other's gaps, and do not denoise each other: the positions of all regions but the largest
 * are moved off the surface, farther than a neighbour may lie off the tangent plane (neighbours.h).
 *
 * Whole texels of a rim beside a wall (bake/points/divided.h) become gaps, which are filled from the region that sees
 * more: an engine that interpolates between two texels would otherwise mix the rim's light into the room. The region
 * that fills them is the one visible next to the wall.
 *
 * All this is read from the map of all texels, which every rank has, so bands of a lightmap need no exchange. */
#include <math.h>
#include <string.h>

#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/stage.h"
#include "worker/base/arena.h"
#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"

static const double LIFT = 0.25; /* of a texel: a twentieth parts points (neighbours.h) */

struct walls {
    struct kiln_map_work *work;
    const struct kiln_surface *surface;
    uint32_t width, height;
    uint32_t *region; /* of each texel; KILN_NONE: there is none */
    uint32_t *claim;  /* per texel: largest region that wants it as a gap of its own; KILN_NONE: none */
    uint32_t *stack;
    size_t stack_room;
    uint32_t count;
    uint32_t *size, *cluster, *order; /* per region; order: number of lifts by which its positions are moved */
    struct kiln_arena arena;
};

/* The divided texel at (x, y); NULL: it is whole, or there is no point. */
static const struct kiln_divided_texel *divided_at(const struct walls *w, uint32_t x, uint32_t y)
{
    const struct kiln_global_point entry = kiln_surface_entry(w->surface, w->work->object, x, y);
    return entry.at != KILN_NO_POINT && (entry.at & KILN_TILE_SPLIT) != 0
               ? &w->surface->divided[entry.at & ~KILN_TILE_SPLIT]
               : NULL;
}

static bool has_point(const struct walls *w, uint32_t x, uint32_t y)
{
    return kiln_surface_entry(w->surface, w->work->object, x, y).at != KILN_NO_POINT;
}

/* The place in its square that represents texel (x, y): where the surface is visible. */
static void shown_place(const struct kiln_divided_texel *t, float place[2])
{
    place[0] = t != NULL ? kiln_divided_shown_x(t) : 0.5f;
    place[1] = t != NULL ? kiln_divided_shown_y(t) : 0.5f;
}

/* The part of a divided texel next to its neighbour (dx, dy) away: the part that contains the neighbour's
 * representative place. */
static uint32_t part_beside(const struct kiln_divided_texel *t, const struct kiln_divided_texel *other, int dx, int dy)
{
    float place[2];
    shown_place(other, place);
    return kiln_divided_subtexel(t, place[0] + (float)dx, place[1] + (float)dy);
}

/* Whether no wall separates the visible parts of two neighbouring texels. */
static bool is_open(const struct walls *w, uint32_t x, uint32_t y, int dx, int dy)
{
    const struct kiln_divided_texel *here = divided_at(w, x, y),
                                    *there = divided_at(w, (uint32_t)((int)x + dx), (uint32_t)((int)y + dy));
    return (here == NULL || part_beside(here, there, dx, dy) == 0) &&
           (there == NULL || part_beside(there, here, -dx, -dy) == 0);
}

static bool is_inside(const struct walls *w, int64_t x, int64_t y)
{
    return x >= 0 && y >= 0 && x < w->width && y < w->height;
}

static const int step_x[4] = {1, -1, 0, 0}, step_y[4] = {0, 0, 1, -1};

static int push(struct walls *w, size_t *top, uint32_t texel, struct kiln_error *error)
{
    const int status = kiln_arena_grow(&w->arena, &w->stack, &w->stack_room, *top + 1, sizeof *w->stack,
                                       "regions of a lightmap", error);
    if (status == KILN_OK)
        w->stack[(*top)++] = texel;
    return status;
}

/* Finds the region of texel `first`: all texels that paths lead to from there. */
static int find_region(struct walls *w, uint32_t first, struct kiln_error *error)
{
    size_t top = 0;
    int status = push(w, &top, first, error);
    w->region[first] = w->count;
    while (status == KILN_OK && top > 0) {
        const uint32_t texel = w->stack[--top], x = texel % w->width, y = texel / w->width;
        for (int k = 0; k < 4 && status == KILN_OK; k++) {
            const int64_t other_x = (int64_t)x + step_x[k], other_y = (int64_t)y + step_y[k];
            if (!is_inside(w, other_x, other_y))
                continue;
            const uint32_t other = (uint32_t)(other_y * w->width + other_x);
            if (w->region[other] != KILN_NONE || !has_point(w, (uint32_t)other_x, (uint32_t)other_y) ||
                !is_open(w, x, y, step_x[k], step_y[k]))
                continue;
            w->region[other] = w->count;
            status = push(w, &top, other, error);
        }
    }
    w->count++;
    return status;
}

static int find_regions(struct walls *w, struct kiln_error *error)
{
    const size_t texels = (size_t)w->width * w->height;
    int status = KILN_OK;
    for (size_t i = 0; i < texels; i++)
        w->region[i] = KILN_NONE;
    for (size_t i = 0; i < texels && status == KILN_OK; i++)
        if (w->region[i] == KILN_NONE && has_point(w, (uint32_t)(i % w->width), (uint32_t)(i / w->width)))
            status = find_region(w, (uint32_t)i, error);
    return status;
}

/* Regions that touch at a wall become one cluster. */
static void join_regions(struct walls *w)
{
    for (uint32_t y = 0; y < w->height; y++)
        for (uint32_t x = 0; x < w->width; x++) {
            const uint32_t here = w->region[(size_t)y * w->width + x];
            if (here == KILN_NONE || divided_at(w, x, y) == NULL)
                continue;
            for (int k = 0; k < 4; k++) {
                const int64_t other_x = (int64_t)x + step_x[k], other_y = (int64_t)y + step_y[k];
                const uint32_t there =
                    is_inside(w, other_x, other_y) ? w->region[other_y * w->width + other_x] : KILN_NONE;
                if (there != KILN_NONE && there != here)
                    kiln_sets_join(w->cluster, here, there);
            }
        }
}

/* Numbers the regions of each cluster: 0 for the largest, which is not moved, then 1, 2, ... */
static int order_regions(struct walls *w, struct kiln_error *error)
{
    uint32_t *largest = NULL, *next = NULL;
    int status;
    KILN_TRY(kiln_allocate(&largest, w->count, sizeof *largest, "regions of a lightmap", error));
    KILN_TRY(kiln_allocate(&next, w->count, sizeof *next, "regions of a lightmap", error));
    for (uint32_t r = 0; r < w->count; r++) {
        const uint32_t root = kiln_sets_root(w->cluster, r);
        if (root == r || w->size[r] > w->size[largest[root]])
            largest[root] = r;
    }
    for (uint32_t r = 0; r < w->count; r++) {
        const uint32_t root = kiln_sets_root(w->cluster, r);
        w->order[r] = largest[root] == r ? 0 : ++next[root];
    }
end:
    kiln_free(&largest);
    kiln_free(&next);
    return status;
}

static int arrange_regions(struct walls *w, struct kiln_error *error)
{
    const char *what = "regions of a lightmap";
    const size_t texels = (size_t)w->width * w->height;
    int status;
    KILN_TRY(kiln_arena_allocate(&w->arena, &w->size, w->count, sizeof *w->size, what, error));
    KILN_TRY(kiln_arena_allocate(&w->arena, &w->cluster, w->count, sizeof *w->cluster, what, error));
    KILN_TRY(kiln_arena_allocate(&w->arena, &w->order, w->count, sizeof *w->order, what, error));
end:
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < texels; i++)
        if (w->region[i] != KILN_NONE)
            w->size[w->region[i]]++;
    kiln_sets_begin(w->cluster, w->count);
    join_regions(w);
    return order_regions(w, error);
}

/* Moves the positions of the map's texels on this rank. */
static void lift_positions(const struct walls *w)
{
    struct kiln_map *map = w->work->map;
    const uint32_t position = w->work->layers->position, normal = w->work->layers->normal;
    const double metre = w->work->report->texels_per_metre;
    if (position == 0 || normal == 0 || !(metre > 0.0))
        return;
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++) {
        const uint32_t order = w->region[i] != KILN_NONE ? w->order[w->region[i]] : 0;
        for (uint32_t c = 0; c < 3 && order > 0; c++)
            map->planes[position + c][i] += (float)(LIFT / metre * order) * map->planes[normal + c][i];
    }
}

/* Makes neighbours of the divided texel (x, y) that lie on the rim beyond its walls gaps of its region. */
static void hide_rims(const struct walls *w, uint32_t x, uint32_t y, const struct kiln_divided_texel *t)
{
    for (uint32_t k = 0; k < KILN_NEIGHBOUR_TEXELS; k++) {
        int step[2];
        kiln_neighbour_texel(k, step);
        const int64_t other_x = (int64_t)x + step[0], other_y = (int64_t)y + step[1];
        if ((t->shown >> k & 1) == 0 || !is_inside(w, other_x, other_y) ||
            !has_point(w, (uint32_t)other_x, (uint32_t)other_y))
            continue;
        if (part_beside(t, divided_at(w, (uint32_t)other_x, (uint32_t)other_y), step[0], step[1]) == 0)
            continue;
        const size_t texel = (size_t)other_y * w->width + (size_t)other_x;
        uint32_t *claim = &w->claim[texel];
        const uint32_t own = w->region[(size_t)y * w->width + x];
        if (*claim == KILN_NONE || w->size[own] > w->size[*claim])
            *claim = own;
    }
}

static void make_gaps(const struct walls *w)
{
    struct kiln_map *map = w->work->map;
    for (size_t i = 0; i < (size_t)w->width * w->height; i++) {
        if (w->claim[i] == KILN_NONE)
            continue;
        w->region[i] = w->claim[i];
        if (i >= kiln_map_first(map) && i < kiln_map_end(map) && map->state[i] == KILN_TEXEL_VALID)
            map->state[i] = KILN_TEXEL_FILLED;
    }
}

static void hide_all_rims(const struct walls *w)
{
    for (size_t i = 0; i < (size_t)w->width * w->height; i++)
        w->claim[i] = KILN_NONE;
    for (uint32_t y = 0; y < w->height; y++)
        for (uint32_t x = 0; x < w->width; x++) {
            const struct kiln_divided_texel *t = divided_at(w, x, y);
            if (t != NULL)
                hide_rims(w, x, y, t);
        }
    make_gaps(w);
}

static bool has_divided(const struct kiln_map_work *work)
{
    const struct kiln_surface *s = work->result->surface;
    const struct kiln_lightmap *map = &s->lightmaps[work->object];
    const uint64_t tiles = (uint64_t)map->tiles_x * map->tiles_y;
    for (uint64_t t = map->tile_first; s->divided_count > 0 && t < map->tile_first + tiles; t++)
        if (s->tiles[t].mask != 0 && (s->tiles[t].first & KILN_TILE_SPLIT) != 0 &&
            (s->splits[s->tiles[t].first & ~KILN_TILE_SPLIT].first.at & KILN_TILE_SPLIT) != 0)
            return true;
    return false;
}

static int part_regions(struct walls *w, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_map_allocate(w->work->map, &w->region, sizeof *w->region, "regions of a lightmap", error));
    KILN_TRY(kiln_map_allocate(w->work->map, &w->claim, sizeof *w->claim, "regions of a lightmap", error));
    KILN_TRY(find_regions(w, error));
    KILN_TRY(arrange_regions(w, error));
end:
    if (status == KILN_OK) {
        lift_positions(w);
        hide_all_rims(w);
        w->work->map->region = w->region;
    } else {
        kiln_map_free(w->work->map, &w->region, sizeof *w->region);
    }
    kiln_map_free(w->work->map, &w->claim, sizeof *w->claim);
    return status;
}

static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    const struct kiln_lightmap *map = &work->result->surface->lightmaps[work->object];
    struct walls w = {.work = work, .surface = work->result->surface, .width = map->width, .height = map->height};
    if (!has_divided(work))
        return KILN_OK;
    const int status = kiln_bands_agree(work->map, part_regions(&w, error), error);
    kiln_arena_release(&w.arena);
    return status;
}

const struct kiln_map_stage kiln_map_stage_walls = {.name = "walls", .run = run};
