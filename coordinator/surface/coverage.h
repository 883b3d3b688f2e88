/* Which triangles of an object cover which texels of its lightmap, tile by tile, with exact areas. */
#ifndef KILN_COORDINATOR_SURFACE_COVERAGE_H
#define KILN_COORDINATOR_SURFACE_COVERAGE_H

#include <stdbool.h>

#include "worker/scene/clip.h"
#include "worker/scene/surface.h"

/* An object's triangles sorted into the tiles they touch; lives while the object is worked on. */
struct kiln_coverage {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    uint32_t width, height, tiles_x, tiles_y, shift; /* as in the lightmap */
    bool back;                                       /* only triangles with two sides */
    uint64_t *tile_first;                            /* tile: its first entry of `triangles`; one more at the end */
    uint32_t *triangles;                             /* world triangles, ascending within a tile */
};

/* The part of one texel that one triangle covers. */
struct kiln_coverage_piece {
    double area;   /* m2 */
    double b1, b2; /* centroid: weights of the triangle's corners 1 and 2 */
    uint32_t triangle;
    uint8_t bit; /* kiln_morton8 of the texel in its tile */
    bool whole;  /* the texel's square lies wholly in the triangle */
};

/* One thread's working space; zero it before first use. */
struct kiln_coverage_scratch {
    struct kiln_coverage_piece *pieces;
    size_t count, capacity;
};

/* Of lightmap `map`, whose size the surface has. Not collective. Runs on `threads` threads; the result does not depend
 * on it. KILN_SYSTEM. */
int kiln_coverage_create(struct kiln_coverage *coverage, const struct kiln_scene *scene,
                         const struct kiln_geometry *geometry, const struct kiln_surface *surface, uint32_t map,
                         uint32_t threads, struct kiln_error *error);
void kiln_coverage_destroy(struct kiln_coverage *coverage);

/* Puts the pieces of tile `tile` (y * tiles_x + x) into scratch->pieces: by triangle, ascending. Triangles without area
 * in the world have none; those without area in the lightmap have one, in the texel that holds their centroid there.
 * Thread-safe with a scratch for each thread. */
int kiln_coverage_tile(const struct kiln_coverage *coverage, uint32_t tile, struct kiln_coverage_scratch *scratch,
                       struct kiln_error *error);
void kiln_coverage_scratch_destroy(struct kiln_coverage_scratch *scratch);

#endif
