#include "coordinator/surface/coverage.h"

#include <stdlib.h>

#include "coordinator/surface/bricks.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

static uint64_t world_triangle(const struct kiln_object_range *range, uint64_t k)
{
    return k < range->opaque_count ? range->opaque_first + k : range->alpha_first + (k - range->opaque_count);
}

/* fmin and fmax would become calls into the mathematics library here. */
static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }

/* Index of the interval of length `size` that holds x, clamped to 0 .. count - 1. */
static uint32_t clamped_index(double x, double size, uint32_t count)
{
    return (uint32_t)least(most(floor(x / size), 0.0), (double)count - 1.0);
}

static double mean(const double c[3][2], int axis) { return (c[0][axis] + c[1][axis] + c[2][axis]) / 3.0; }

static bool is_collapsed(const double c[3][2]) { return !(fabs(kiln_clip_twice_area(c)) > 0.0); }

static void vertical_reach(const double c[3][2], double *low, double *high)
{
    *low = least(c[0][1], least(c[1][1], c[2][1]));
    *high = most(c[0][1], most(c[1][1], c[2][1]));
}

/* Counting sort, both passes. Without `out`: counts a triangle of `tile` in place[tile + 1]. With `out`: writes the
 * triangle to the tile's next place, which is place[tile], and advances that. */
static void bin_into(uint64_t tile, uint32_t triangle, uint64_t *place, uint32_t *out)
{
    uint64_t at;
    uint64_t *counter = &place[out == NULL ? tile + 1 : tile];
#pragma omp atomic capture
    at = (*counter)++;
    if (out != NULL)
        out[at] = triangle;
}

/* Where bin_brick puts a triangle. */
struct brick_bin {
    const struct kiln_coverage *coverage;
    uint32_t triangle;
    uint64_t *place;
    uint32_t *out;
};

static void bin_brick(void *context, uint64_t place)
{
    const struct brick_bin *b = context;
    const struct kiln_surface *s = b->coverage->surface;
    const struct kiln_brick_slot *slot = kiln_brick_slot(s, b->coverage->map, place);
    bin_into(slot->tile - 1 - s->lightmaps[b->coverage->map].tile_first, b->triangle, b->place, b->out);
}

/* The same for an octree. */
static void bin_leaves(const struct kiln_coverage *c, uint32_t triangle, uint64_t *place, uint32_t *out)
{
    struct brick_bin b = {c, triangle, place, out};
    if (c->geometry->leaves[triangle].side == c->side &&
        (!c->back || (c->geometry->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) != 0))
        kiln_bricks_of(c->geometry, triangle, bin_brick, &b);
}

/* Passes each tile that the triangle touches to bin_into. A triangle without area in the world touches none. */
static void bin(const struct kiln_coverage *c, uint32_t triangle, uint64_t *place, uint32_t *out)
{
    double corner[3][2];
    if (c->leaves) {
        bin_leaves(c, triangle, place, out);
        return;
    }
    kiln_geometry_map_corners(c->scene, c->geometry, triangle, c->shift, corner);
    if (!(kiln_geometry_triangle_area(c->geometry, triangle) > 0.0))
        return;
    if (c->back && (c->geometry->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0)
        return;
    if (is_collapsed(corner)) {
        const uint32_t x = clamped_index(mean(corner, 0), 1.0, c->width),
                       y = clamped_index(mean(corner, 1), 1.0, c->height);
        bin_into((uint64_t)(y / KILN_TILE_SIDE) * c->tiles_x + x / KILN_TILE_SIDE, triangle, place, out);
        return;
    }
    double bottom, top;
    vertical_reach(corner, &bottom, &top);
    const uint32_t ty1 = clamped_index(top, KILN_TILE_SIDE, c->tiles_y);
    for (uint32_t ty = clamped_index(bottom, KILN_TILE_SIDE, c->tiles_y); ty <= ty1; ty++) {
        double low, high;
        if (!kiln_clip_reach(corner, (double)ty * KILN_TILE_SIDE, ((double)ty + 1.0) * KILN_TILE_SIDE, &low, &high))
            continue;
        const uint32_t tx1 = clamped_index(high, KILN_TILE_SIDE, c->tiles_x);
        for (uint32_t tx = clamped_index(low, KILN_TILE_SIDE, c->tiles_x); tx <= tx1; tx++)
            bin_into((uint64_t)ty * c->tiles_x + tx, triangle, place, out);
    }
}

static int ascending(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return x < y ? -1 : x > y ? 1 : 0;
}

static void sort_tile(uint32_t *triangles, uint64_t count)
{
    for (uint64_t i = 1; i < count; i++) {
        if (triangles[i - 1] > triangles[i]) {
            qsort(triangles, count, sizeof *triangles, ascending);
            return;
        }
    }
}

int kiln_coverage_create(struct kiln_coverage *coverage, const struct kiln_scene *scene,
                         const struct kiln_geometry *geometry, const struct kiln_surface *surface, uint32_t map,
                         uint32_t threads, struct kiln_error *error)
{
    const struct kiln_lightmap *lightmap = &surface->lightmaps[map];
    *coverage = (struct kiln_coverage){.scene = scene,
                                       .geometry = geometry,
                                       .surface = surface,
                                       .map = map,
                                       .leaves = surface->bricks != NULL,
                                       .side = map % kiln_front_maps(surface) / surface->object_count,
                                       .width = lightmap->width,
                                       .height = lightmap->height,
                                       .tiles_x = lightmap->tiles_x,
                                       .tiles_y = lightmap->tiles_y,
                                       .shift = lightmap->shift,
                                       .back = kiln_map_back(surface, map)};
    struct kiln_coverage *c = coverage;
    const struct kiln_object_range *range = &geometry->ranges[kiln_map_object(surface, map)];
    const uint64_t tiles = (uint64_t)c->tiles_x * c->tiles_y, count = range->opaque_count + range->alpha_count;
    const int team = (int)threads;
    int status = kiln_allocate(&c->tile_first, tiles + 2, sizeof *c->tile_first, "an object's tiles", error);
    if (status != KILN_OK)
        goto end;
    /* The counts are kept one entry further on. Filling advances each tile's place to the tile's end, which is the next
     * tile's beginning: tile_first then holds the beginnings. */
    uint64_t *place = c->tile_first + 1;
#pragma omp parallel for schedule(dynamic, 1024) num_threads(team)
    for (uint64_t k = 0; k < count; k++)
        bin(c, (uint32_t)world_triangle(range, k), place, NULL);
    for (uint64_t tile = 0; tile < tiles; tile++)
        place[tile + 1] += place[tile];
    status =
        kiln_allocate(&c->triangles, place[tiles], sizeof *c->triangles, "the triangles of an object's tiles", error);
    if (status != KILN_OK)
        goto end;
#pragma omp parallel for schedule(dynamic, 1024) num_threads(team)
    for (uint64_t k = 0; k < count; k++)
        bin(c, (uint32_t)world_triangle(range, k), place, c->triangles);
#pragma omp parallel for schedule(dynamic, 256) num_threads(team)
    for (uint64_t tile = 0; tile < tiles; tile++)
        sort_tile(c->triangles + c->tile_first[tile], c->tile_first[tile + 1] - c->tile_first[tile]);
end:
    if (status != KILN_OK)
        kiln_coverage_destroy(coverage);
    return status;
}

void kiln_coverage_destroy(struct kiln_coverage *coverage)
{
    kiln_free(&coverage->tile_first);
    kiln_free(&coverage->triangles);
}

void kiln_coverage_scratch_destroy(struct kiln_coverage_scratch *scratch)
{
    kiln_free(&scratch->pieces);
    *scratch = (struct kiln_coverage_scratch){0};
}

struct tile_window {
    uint32_t x, y;          /* first texel */
    uint32_t width, height; /* texels of the tile that lie in the lightmap */
};

static void add_piece(struct kiln_coverage_scratch *scratch, uint32_t triangle, uint32_t x, uint32_t y, bool whole,
                      double area, double b1, double b2)
{
    scratch->pieces[scratch->count++] =
        (struct kiln_coverage_piece){area, b1, b2, triangle, (uint8_t)kiln_morton8(x, y), whole};
}

/* Adds the piece of one triangle in one texel. `area`: of the triangle, m2; `texels`: its area in the lightmap, texels
 * (0: none there). */
static void cover_texel(struct kiln_coverage_scratch *scratch, const struct tile_window *window, uint32_t triangle,
                        const double corner[3][2], double area, double texels, uint32_t x, uint32_t y)
{
    double local[3][2];
    kiln_clip_local(corner, (double)window->x + x, (double)window->y + y, local);
    if (texels > 0.0) {
        const enum kiln_clip_class class = kiln_clip_classify(local, 0.0, 0.0, 1.0, 1.0);
        if (class == KILN_CLIP_OUTSIDE)
            return;
        if (class == KILN_CLIP_INSIDE) {
            const struct kiln_clip_weights w = kiln_clip_weights(local);
            add_piece(scratch, triangle, x, y, true, area / texels, w.b1[0] + 0.5 * (w.b1[1] + w.b1[2]),
                      w.b2[0] + 0.5 * (w.b2[1] + w.b2[2]));
            return;
        }
    }
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid;
    const uint32_t count = kiln_clip_triangle(local, 0.0, 0.0, 1.0, 1.0, polygon);
    const double fraction = kiln_clip_fraction(polygon, count, &centroid);
    if (fraction > kiln_clip_smallest(texels))
        add_piece(scratch, triangle, x, y, false, fraction * area, centroid.b1, centroid.b2);
}

/* Adds the pieces of one triangle in one tile. The scratch has room for 64 more. */
static void cover(const struct kiln_coverage *c, const struct tile_window *window, uint64_t wanted, uint32_t triangle,
                  struct kiln_coverage_scratch *scratch)
{
    double corner[3][2];
    kiln_geometry_map_corners(c->scene, c->geometry, triangle, c->shift, corner);
    const double texels = 0.5 * fabs(kiln_clip_twice_area(corner));
    const double area = kiln_geometry_triangle_area(c->geometry, triangle);
    const double x0 = window->x, y0 = window->y;
    if (is_collapsed(corner)) {
        const uint32_t x = clamped_index(mean(corner, 0), 1.0, c->width),
                       y = clamped_index(mean(corner, 1), 1.0, c->height);
        cover_texel(scratch, window, triangle, corner, area, 0.0, x - window->x, y - window->y);
        return;
    }
    double bottom, top;
    vertical_reach(corner, &bottom, &top);
    const uint32_t row_last = clamped_index(top - y0, 1.0, window->height);
    for (uint32_t y = clamped_index(bottom - y0, 1.0, window->height); y <= row_last; y++) {
        double low, high;
        if (!kiln_clip_reach(corner, y0 + y, y0 + y + 1.0, &low, &high))
            continue;
        const uint32_t x_last = clamped_index(high - x0, 1.0, window->width);
        for (uint32_t x = clamped_index(low - x0, 1.0, window->width); x <= x_last; x++)
            if ((wanted >> kiln_morton8(x, y) & 1u) != 0)
                cover_texel(scratch, window, triangle, corner, area, texels, x, y);
    }
}

/* ---- leaves ---- */

/* A triangle and a column of octree leaves in a brick, for finding the triangle's pieces in these leaves. A brick is a
 * cube of 4 x 4 x 4 leaves (worker/scene/surface.h). */
struct leaf_column {
    const struct kiln_coverage *coverage;
    uint32_t triangle;
    struct kiln_texel_place first; /* its first leaf */
    double area, texels;           /* of the triangle: m2, and squares of leaves */
};

static void add_leaf(struct kiln_coverage_scratch *scratch, const struct leaf_column *at, uint32_t layer, bool whole,
                     double area, double b1, double b2)
{
    scratch->pieces[scratch->count++] = (struct kiln_coverage_piece){
        area, b1, b2, at->triangle, (uint8_t)kiln_morton4(at->first.x, at->first.y, layer), whole};
}

/* Adds the piece that lies in one leaf of the column. */
static void cover_leaf(struct kiln_coverage_scratch *scratch, const struct leaf_column *at, uint32_t layer)
{
    struct kiln_texel_place place = at->first;
    struct kiln_texel_triangle local;
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], centroid;
    place.layer += layer;
    kiln_texel_triangle(at->coverage->scene, at->coverage->geometry, at->triangle, &place, &local);
    const uint32_t count = kiln_texel_clip(&local, 0.0, 0.0, 1.0, 1.0, polygon);
    const double fraction = kiln_clip_fraction(polygon, count, &centroid);
    if (fraction > kiln_clip_smallest(at->texels))
        add_leaf(scratch, at, layer, false, fraction * at->area, centroid.b1, centroid.b2);
}

/* Whether the triangle, over the column's square, stays within one layer of leaves. *low, *high: its range of depths.
 */
static bool is_one_layer(const struct kiln_texel_triangle *local, const struct kiln_clip_weights *w, double *low,
                         double *high)
{
    *low = INFINITY;
    *high = -INFINITY;
    for (int k = 0; k < 4; k++) {
        const double x = k % 2, y = k / 2;
        const struct kiln_clip_corner corner = {.b1 = w->b1[0] + w->b1[1] * x + w->b1[2] * y,
                                                .b2 = w->b2[0] + w->b2[1] * x + w->b2[2] * y};
        *low = least(*low, kiln_clip_depth(&corner, local->depth));
        *high = most(*high, kiln_clip_depth(&corner, local->depth));
    }
    return floor(*low) >= floor(*high);
}

/* Adds the pieces in one column of leaves, for a triangle that has area over x and y. */
static void cover_column(struct kiln_coverage_scratch *scratch, const struct leaf_column *at)
{
    struct kiln_texel_triangle local;
    double low = INFINITY, high = -INFINITY;
    kiln_texel_triangle(at->coverage->scene, at->coverage->geometry, at->triangle, &at->first, &local);
    const enum kiln_clip_class class = kiln_clip_classify(local.corner, 0.0, 0.0, 1.0, 1.0);
    if (class == KILN_CLIP_OUTSIDE)
        return;
    if (class == KILN_CLIP_INSIDE) {
        const struct kiln_clip_weights w = kiln_clip_weights(local.corner);
        if (is_one_layer(&local, &w, &low, &high)) {
            if (low >= 0.0 && low < KILN_BRICK_SIDE)
                add_leaf(scratch, at, (uint32_t)low, true, at->area / at->texels, w.b1[0] + 0.5 * (w.b1[1] + w.b1[2]),
                         w.b2[0] + 0.5 * (w.b2[1] + w.b2[2]));
            return;
        }
    } else {
        struct kiln_clip_corner polygon[KILN_CLIP_CORNERS];
        const uint32_t count = kiln_clip_triangle(local.corner, 0.0, 0.0, 1.0, 1.0, polygon);
        for (uint32_t i = 0; i < count; i++) {
            low = least(low, kiln_clip_depth(&polygon[i], local.depth));
            high = most(high, kiln_clip_depth(&polygon[i], local.depth));
        }
    }
    for (uint32_t layer = clamped_index(low, 1.0, KILN_BRICK_SIDE);
         layer < KILN_BRICK_SIDE && (double)layer <= high && low < KILN_BRICK_SIDE; layer++)
        cover_leaf(scratch, at, layer);
}

/* Adds the pieces of one triangle in one brick. The scratch has room for 64 more. */
static void cover_brick(const struct kiln_coverage *c, const struct kiln_texel_place *brick, uint32_t triangle,
                        struct kiln_coverage_scratch *scratch)
{
    struct kiln_texel_triangle local;
    struct leaf_column at = {.coverage = c, .triangle = triangle, .first = *brick};
    kiln_texel_triangle(c->scene, c->geometry, triangle, brick, &local);
    at.area = kiln_geometry_triangle_area(c->geometry, triangle);
    at.texels = 0.5 * fabs(kiln_clip_twice_area(local.corner));
    if (is_collapsed(local.corner)) {
        at.first.x += clamped_index(mean(local.corner, 0), 1.0, KILN_BRICK_SIDE);
        at.first.y += clamped_index(mean(local.corner, 1), 1.0, KILN_BRICK_SIDE);
        cover_leaf(scratch, &at,
                   clamped_index((local.depth[0] + local.depth[1] + local.depth[2]) / 3.0, 1.0, KILN_BRICK_SIDE));
        return;
    }
    double bottom, top, low, high;
    vertical_reach(local.corner, &bottom, &top);
    const uint32_t last = clamped_index(top, 1.0, KILN_BRICK_SIDE);
    for (uint32_t y = clamped_index(bottom, 1.0, KILN_BRICK_SIDE); y <= last; y++) {
        if (!kiln_clip_reach(local.corner, y, y + 1.0, &low, &high))
            continue;
        const uint32_t x_last = clamped_index(high, 1.0, KILN_BRICK_SIDE);
        for (uint32_t x = clamped_index(low, 1.0, KILN_BRICK_SIDE); x <= x_last; x++) {
            at.first.x = brick->x + x;
            at.first.y = brick->y + y;
            cover_column(scratch, &at);
        }
    }
}

int kiln_coverage_tile(const struct kiln_coverage *coverage, uint32_t tile, uint64_t wanted,
                       struct kiln_coverage_scratch *scratch, struct kiln_error *error)
{
    const struct kiln_coverage *c = coverage;
    const struct kiln_texel_place brick =
        c->leaves ? kiln_brick_first(c->surface, c->map, tile) : (struct kiln_texel_place){0};
    struct tile_window window = {.x = tile % c->tiles_x * KILN_TILE_SIDE, .y = tile / c->tiles_x * KILN_TILE_SIDE};
    window.width = c->width - window.x < KILN_TILE_SIDE ? c->width - window.x : KILN_TILE_SIDE;
    window.height = c->height - window.y < KILN_TILE_SIDE ? c->height - window.y : KILN_TILE_SIDE;
    scratch->count = 0;
    for (uint64_t i = c->tile_first[tile]; i < c->tile_first[tile + 1]; i++) {
        const int status = kiln_grow(&scratch->pieces, &scratch->capacity, scratch->count + KILN_TILE_TEXELS,
                                     sizeof *scratch->pieces, "the pieces of a lightmap tile", error);
        if (status != KILN_OK)
            return status;
        if (c->leaves)
            cover_brick(c, &brick, c->triangles[i], scratch);
        else
            cover(c, &window, wanted, c->triangles[i], scratch);
    }
    return KILN_OK;
}
