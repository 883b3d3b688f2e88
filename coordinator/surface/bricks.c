#include "coordinator/surface/bricks.h"

#include <stdlib.h>
#include <string.h>

#include "worker/base/memory.h"
#include "worker/scene/texel.h"

static const uint64_t MOST_BRICKS = 1ull << 29; /* in one octree: columns of its leaves have 32-bit numbers */

/* ---- the bricks of one triangle ---- */

/* Depth of a triangle as a linear function of x and y, in bricks from its corner 0. */
struct slope {
    double low, high; /* of the triangle */
    double along_x, along_y;
    double slack; /* more than the rounding error */
};

static struct slope slope_of(const double corner[3][2], const double depth[3])
{
    struct slope s = {.low = fmin(depth[0], fmin(depth[1], depth[2])),
                      .high = fmax(depth[0], fmax(depth[1], depth[2]))};
    const struct kiln_clip_weights w = kiln_clip_weights(corner);
    const double a = depth[1] - depth[0], b = depth[2] - depth[0];
    s.along_x = w.b1[1] * a + w.b2[1] * b;
    s.along_y = w.b1[2] * a + w.b2[2] * b;
    const double length = fabs(corner[1][0] - corner[0][0]) + fabs(corner[1][1] - corner[0][1]) +
                          fabs(corner[2][0] - corner[0][0]) + fabs(corner[2][1] - corner[0][1]);
    s.slack = 1e-9 * (1.0 + s.high) + 1e-14 * length * length * length / fabs(kiln_clip_twice_area(corner));
    return s;
}

/* Bounds of the triangle's depth over the unit square of column (x, y). */
static void depths_over(const struct slope *s, const double corner[3][2], const double depth[3], double x, double y,
                        double *low, double *high)
{
    const double middle = depth[0] + s->along_x * (x + 0.5 - corner[0][0]) + s->along_y * (y + 0.5 - corner[0][1]);
    const double half = 0.5 * (fabs(s->along_x) + fabs(s->along_y)) + s->slack;
    *low = fmax(s->low, middle - half);
    *high = fmin(s->high, middle + half);
    if (!(*low <= *high)) {
        *low = s->low;
        *high = s->high;
    }
}

static uint32_t floor_of(double x) { return (uint32_t)fmax(floor(x), 0.0); }

static void visit_columns(const double corner[3][2], const double depth[3],
                          void (*visit)(void *context, uint64_t place), void *context)
{
    const struct slope slope = slope_of(corner, depth);
    const uint32_t last_y = floor_of(fmax(corner[0][1], fmax(corner[1][1], corner[2][1])));
    for (uint32_t y = floor_of(fmin(corner[0][1], fmin(corner[1][1], corner[2][1]))); y <= last_y; y++) {
        double left, right, low, high;
        if (!kiln_clip_reach(corner, y, (double)y + 1.0, &left, &right))
            continue;
        const uint32_t last_x = floor_of(right);
        for (uint32_t x = floor_of(left); x <= last_x; x++) {
            depths_over(&slope, corner, depth, x, y, &low, &high);
            for (uint32_t layer = floor_of(low), last = floor_of(high); layer <= last; layer++)
                visit(context, kiln_brick_place(x, y, layer));
        }
    }
}

void kiln_bricks_of(const struct kiln_geometry *geometry, uint32_t triangle,
                    void (*visit)(void *context, uint64_t place), void *context)
{
    double leaf[3][3], corner[3][2], depth[3];
    if (!(kiln_geometry_triangle_area(geometry, triangle) > 0.0))
        return;
    kiln_leaf_corners(geometry, triangle, leaf);
    for (int c = 0; c < 3; c++) {
        corner[c][0] = leaf[c][0] / KILN_BRICK_SIDE;
        corner[c][1] = leaf[c][1] / KILN_BRICK_SIDE;
        depth[c] = leaf[c][2] / KILN_BRICK_SIDE;
    }
    if (fabs(kiln_clip_twice_area(corner)) > 0.0)
        visit_columns(corner, depth, visit, context);
    else
        visit(context, kiln_brick_place(floor_of((corner[0][0] + corner[1][0] + corner[2][0]) / 3.0),
                                        floor_of((corner[0][1] + corner[1][1] + corner[2][1]) / 3.0),
                                        floor_of((depth[0] + depth[1] + depth[2]) / 3.0)));
}

/* ---- the bricks of an octree ---- */

struct codes {
    uint64_t *code; /* Morton codes */
    size_t count, room;
    int status;
    struct kiln_error *error;
};

static void add_code(void *context, uint64_t place)
{
    struct codes *c = context;
    const uint64_t code = kiln_morton_spread(kiln_brick_x(place)) | kiln_morton_spread(kiln_brick_y(place)) << 1 |
                          kiln_morton_spread(kiln_brick_layer(place)) << 2;
    if (c->status != KILN_OK || (c->count > 0 && c->code[c->count - 1] == code))
        return;
    c->status = kiln_grow(&c->code, &c->room, c->count + 1, sizeof *c->code, "the bricks of an octree", c->error);
    if (c->status == KILN_OK)
        c->code[c->count++] = code;
}

static uint32_t gather_bits(uint64_t code)
{
    uint32_t x = 0;
    for (uint32_t i = 0; i < 21; i++)
        x |= (uint32_t)(code >> 3 * i & 1u) << i;
    return x;
}

static int ascending(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y ? 1 : 0;
}

/* Sorts by bytes, lowest first, skipping those that are equal everywhere. */
static int sort_codes(struct codes *c)
{
    enum { DIGITS = 256, SMALL = 256 };
    if (c->count < SMALL) {
        if (c->count > 1)
            qsort(c->code, c->count, sizeof *c->code, ascending);
        return KILN_OK;
    }
    uint64_t *other = NULL;
    const int status = kiln_allocate(&other, c->count, sizeof *other, "the bricks of an octree", c->error);
    for (uint32_t shift = 0; shift < 64 && status == KILN_OK; shift += 8) {
        size_t place[DIGITS + 1] = {0};
        for (size_t i = 0; i < c->count; i++)
            place[(c->code[i] >> shift & 0xff) + 1]++;
        if (place[(c->code[0] >> shift & 0xff) + 1] == c->count)
            continue;
        for (int d = 0; d < DIGITS; d++)
            place[d + 1] += place[d];
        for (size_t i = 0; i < c->count; i++)
            other[place[c->code[i] >> shift & 0xff]++] = c->code[i];
        uint64_t *swap = c->code;
        c->code = other;
        other = swap;
        c->room = c->count;
    }
    kiln_free(&other);
    return status;
}

static size_t drop_repeated(struct codes *c)
{
    size_t kept = 0;
    for (size_t i = 0; i < c->count; i++)
        if (kept == 0 || c->code[kept - 1] != c->code[i])
            c->code[kept++] = c->code[i];
    return c->count = kept;
}

/* Lists the places of an octree's bricks in Morton order. */
static int list_bricks(const struct kiln_build *build, uint32_t map, struct codes *c)
{
    const struct kiln_geometry *g = build->geometry;
    const uint32_t fronts = kiln_front_maps(build->surface), side = map % fronts / build->surface->object_count;
    const struct kiln_object_range *range = &g->ranges[kiln_map_object(build->surface, map)];
    const uint64_t count = range->opaque_count + range->alpha_count;
    for (uint64_t k = 0; k < count && c->status == KILN_OK; k++) {
        const uint64_t t =
            k < range->opaque_count ? range->opaque_first + k : range->alpha_first + k - range->opaque_count;
        if (g->leaves[t].side == side && (map < fronts || (g->records[t].material & KILN_RECORD_DOUBLE_SIDED) != 0))
            kiln_bricks_of(g, (uint32_t)t, add_code, c);
    }
    if (c->status == KILN_OK)
        c->status = sort_codes(c);
    drop_repeated(c);
    for (size_t i = 0; i < c->count; i++)
        c->code[i] =
            kiln_brick_place(gather_bits(c->code[i]), gather_bits(c->code[i] >> 1), gather_bits(c->code[i] >> 2));
    return c->status;
}

/* ---- all octrees ---- */

/* Enters the bricks into the hash table, of which they fill half to a quarter. */
static int fill_slots(struct kiln_build *build)
{
    struct kiln_surface *s = build->surface;
    s->slot_count = 1;
    while (s->slot_count < s->tile_count + s->tile_count / 2 + 1)
        s->slot_count *= 2;
    const int status = kiln_allocate(&s->slots, s->slot_count, sizeof *s->slots, "the slots of bricks", build->error);
    for (uint32_t map = 0; map < s->map_count && status == KILN_OK; map++)
        for (uint64_t i = 0; i < s->lightmaps[map].tiles_x; i++) {
            const uint64_t tile = s->lightmaps[map].tile_first + i, place = s->bricks[tile];
            struct kiln_brick_slot *slot = &s->slots[kiln_brick_slot(s, map, place) - s->slots];
            *slot = (struct kiln_brick_slot){place, map, (uint32_t)(tile + 1)};
        }
    return status;
}

/* Concatenates the lists of all octrees. */
static int join_lists(struct kiln_build *build, const struct codes *lists)
{
    struct kiln_surface *s = build->surface;
    for (uint32_t map = 0; map < s->map_count; map++) {
        if (lists[map].count >= MOST_BRICKS || s->tile_count + lists[map].count >= UINT32_MAX)
            return kiln_fail(build->error, KILN_BAD_INPUT,
                             "object '%s': leaves of %g m make more bricks than kiln can hold: give a larger "
                             "--leaf-size",
                             kiln_scene_string(build->scene, build->scene->objects[kiln_map_object(s, map)].name),
                             build->geometry->leaf_size);
        const uint32_t bricks = (uint32_t)lists[map].count;
        s->lightmaps[map] = (struct kiln_lightmap){.tile_first = s->tile_count,
                                                   .width = KILN_TILE_SIDE * bricks,
                                                   .height = bricks > 0 ? KILN_TILE_SIDE : 0,
                                                   .tiles_x = bricks,
                                                   .tiles_y = bricks > 0 ? 1 : 0};
        s->tile_count += bricks;
    }
    kiln_free(&s->bricks);
    const int status = kiln_allocate(&s->bricks, s->tile_count, sizeof *s->bricks, "the bricks", build->error);
    for (uint32_t map = 0; map < s->map_count && status == KILN_OK; map++)
        if (lists[map].count > 0)
            memcpy(s->bricks + s->lightmaps[map].tile_first, lists[map].code, lists[map].count * sizeof *s->bricks);
    return status;
}

int kiln_bricks_find(struct kiln_build *build, bool (*has_backs)(const struct kiln_build *build, size_t object))
{
    struct kiln_surface *s = build->surface;
    struct codes *lists = NULL;
    const int team = (int)build->threads;
    /* an empty list for now, which marks the surface as one with octrees */
    int status = kiln_allocate(&s->bricks, 0, sizeof *s->bricks, "the bricks", build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&lists, s->map_count, sizeof *lists, "the bricks of all octrees", build->error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 1) num_threads(team)
    for (uint32_t map = 0; map < s->map_count; map++) {
        struct kiln_error error;
        struct codes own = {.error = &error};
        if (kiln_build_failed(build) || (kiln_map_back(s, map) && !has_backs(build, kiln_map_object(s, map))))
            continue;
        if (list_bricks(build, map, &own) != KILN_OK)
            kiln_build_fail(build, own.status, &error);
        lists[map] = own;
    }
    status = build->status;
    if (status == KILN_OK)
        status = join_lists(build, lists);
    for (uint32_t map = 0; map < s->map_count; map++)
        kiln_free(&lists[map].code);
    kiln_free(&lists);
    return status == KILN_OK ? fill_slots(build) : status;
}
