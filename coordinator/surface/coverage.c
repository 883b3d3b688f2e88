#include "coordinator/surface/coverage.h"

#include <stdlib.h>

#include "worker/base/memory.h"

static uint64_t world_triangle(const struct kiln_object_range *range, uint64_t k)
{
    return k < range->opaque_count ? range->opaque_first + k : range->alpha_first + (k - range->opaque_count);
}

/* fmin and fmax would become calls into the mathematics library here. */
static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }

/* The range in x that the triangle reaches between the heights y0 and y1. It is widened by more than the rounding
 * error: clipping decides in the end. False when the triangle does not reach between them. */
static bool reach_between(const double c[3][2], double y0, double y1, double *low, double *high)
{
    double x0 = INFINITY, x1 = -INFINITY;
    for (int i = 0; i < 3; i++) {
        const double *a = c[i], *b = c[i == 2 ? 0 : i + 1];
        if (a[1] >= y0 && a[1] <= y1) {
            x0 = least(x0, a[0]);
            x1 = most(x1, a[0]);
        }
        for (int side = 0; side < 2; side++) {
            const double y = side == 0 ? y0 : y1;
            if ((a[1] < y) != (b[1] < y)) {
                const double x = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                x0 = least(x0, x);
                x1 = most(x1, x);
            }
        }
    }
    *low = x0 - 1e-9 * (1.0 + fabs(x0));
    *high = x1 + 1e-9 * (1.0 + fabs(x1));
    return x0 <= x1;
}

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

/* Passes each tile that the triangle touches to bin_into. A triangle without area in the world touches none. */
static void bin(const struct kiln_coverage *c, uint32_t triangle, uint64_t *place, uint32_t *out)
{
    double corner[3][2];
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
        if (!reach_between(corner, (double)ty * KILN_TILE_SIDE, ((double)ty + 1.0) * KILN_TILE_SIDE, &low, &high))
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
static void cover(const struct kiln_coverage *c, const struct tile_window *window, uint32_t triangle,
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
        if (!reach_between(corner, y0 + y, y0 + y + 1.0, &low, &high))
            continue;
        const uint32_t x_last = clamped_index(high - x0, 1.0, window->width);
        for (uint32_t x = clamped_index(low - x0, 1.0, window->width); x <= x_last; x++)
            cover_texel(scratch, window, triangle, corner, area, texels, x, y);
    }
}

int kiln_coverage_tile(const struct kiln_coverage *coverage, uint32_t tile, struct kiln_coverage_scratch *scratch,
                       struct kiln_error *error)
{
    const struct kiln_coverage *c = coverage;
    struct tile_window window = {.x = tile % c->tiles_x * KILN_TILE_SIDE, .y = tile / c->tiles_x * KILN_TILE_SIDE};
    window.width = c->width - window.x < KILN_TILE_SIDE ? c->width - window.x : KILN_TILE_SIDE;
    window.height = c->height - window.y < KILN_TILE_SIDE ? c->height - window.y : KILN_TILE_SIDE;
    scratch->count = 0;
    for (uint64_t i = c->tile_first[tile]; i < c->tile_first[tile + 1]; i++) {
        const int status = kiln_grow(&scratch->pieces, &scratch->capacity, scratch->count + KILN_TILE_TEXELS,
                                     sizeof *scratch->pieces, "the pieces of a lightmap tile", error);
        if (status != KILN_OK)
            return status;
        cover(c, &window, c->triangles[i], scratch);
    }
    return KILN_OK;
}
