/* Coverage: finds, tile by tile, the triangles that cover each texel of an object's lightmap, with exact areas. */
#ifndef KILN_COORDINATOR_SURFACE_COVERAGE_H
#define KILN_COORDINATOR_SURFACE_COVERAGE_H

#include <stdbool.h>

#include "worker/scene/clip.h"
#include "worker/scene/surface.h"

/* The triangles of one lightmap or octree, binned by the tiles they touch. A temporary of the build. Borrows scene,
 * geometry and surface. */
struct kiln_coverage {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_surface *surface;
    uint32_t map;
    uint32_t width, height, tiles_x, tiles_y, shift; /* as in the lightmap */
    /* the lightmap is that of the object's backs: only double-sided triangles are binned */
    bool back;
    bool leaves;   /* an octree, whose tiles are bricks: only the triangles of side `side` are binned */
    uint32_t side; /* with `leaves`: the side of the octree */
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
    bool whole;  /* the triangle covers the whole square of the texel, or of the leaf in projection */
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

/* Writes the pieces of tile number `tile` (y * tiles_x + x) into scratch->pieces, by ascending triangle: all pieces of
 * the texels whose bits are set in `wanted`, perhaps also of others. A triangle without area in the world has no
 * pieces. One without area in the lightmap has one piece, in the texel that holds its centroid there. Thread-safe with
 * one scratch for each thread. */
int kiln_coverage_tile(const struct kiln_coverage *coverage, uint32_t tile, uint64_t wanted,
                       struct kiln_coverage_scratch *scratch, struct kiln_error *error);
void kiln_coverage_scratch_destroy(struct kiln_coverage_scratch *scratch);

#endif
