/* Coverage: which triangles of an object cover which texels of its lightmap, tile by tile, with exact areas. */
#ifndef KILN_COORDINATOR_SURFACE_COVERAGE_H
#define KILN_COORDINATOR_SURFACE_COVERAGE_H

#include <stdbool.h>

#include "worker/scene/clip.h"
#include "worker/scene/surface.h"

/* The triangles of one lightmap or octree, binned by the tiles they touch. Exists while it is worked on. Borrows scene,
 * geometry and surface. */
struct kiln_coverage {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_surface *surface;
    uint32_t map;
    uint32_t width, height, tiles_x, tiles_y, shift; /* as in the lightmap */
    /* the lightmap is that of the object's backs: only double-sided triangles are binned */
    bool back;
    bool leaves;   /* it is an octree, and its tiles are bricks: only the triangles of one side are binned */
    uint32_t side; /* that side */
    /* one per tile, and one more at the end: its first entry in `triangles` */
    uint64_t *tile_first;
    uint32_t *triangles; /* world triangle numbers, ascending within a tile */
};

/* The piece of one texel that one triangle covers. */
struct kiln_coverage_piece {
    double area;   /* on the surface, m2 */
    double b1, b2; /* barycentric weights of the piece's centroid, for the triangle's corners 1 and 2 */
    uint32_t triangle;
    uint8_t bit; /* the texel's bit in its tile, kiln_morton8(x, y), or the leaf's in its brick, kiln_morton4 */
    bool whole;  /* the triangle holds the whole square of the texel, or crosses the leaf over all of its square */
};

/* Working memory of one thread. Zero-initialise; free with kiln_coverage_scratch_destroy. */
struct kiln_coverage_scratch {
    struct kiln_coverage_piece *pieces;
    size_t count, capacity;
};

/* Bins the triangles of lightmap `map`; its width, height and tiles must be set in the surface. Not collective. Runs on
 * `threads` threads; the result does not depend on their number. KILN_SYSTEM. Destroy with kiln_coverage_destroy. */
int kiln_coverage_create(struct kiln_coverage *coverage, const struct kiln_scene *scene,
                         const struct kiln_geometry *geometry, const struct kiln_surface *surface, uint32_t map,
                         uint32_t threads, struct kiln_error *error);
void kiln_coverage_destroy(struct kiln_coverage *coverage);

/* Writes the pieces of tile number `tile` (y * tiles_x + x) into scratch->pieces, by ascending triangle: of the texels
 * whose bits `wanted` has at least, all of these. A triangle
 * without area in the world has no pieces. One without area in the lightmap has one piece, in the texel that holds its
 * centroid there. Thread-safe with one scratch for each thread. */
int kiln_coverage_tile(const struct kiln_coverage *coverage, uint32_t tile, uint64_t wanted,
                       struct kiln_coverage_scratch *scratch, struct kiln_error *error);
void kiln_coverage_scratch_destroy(struct kiln_coverage_scratch *scratch);

#endif
