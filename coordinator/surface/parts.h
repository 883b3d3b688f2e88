/* Parts of divided texels: adds surface points to a surface for the parts into which walls divide texels (struct
 * kiln_divided_texel of worker/scene/surface.h). */
#ifndef KILN_COORDINATOR_SURFACE_PARTS_H
#define KILN_COORDINATOR_SURFACE_PARTS_H

#include "worker/scene/surface.h"

/* A divided texel. `divided` is complete except for point numbers: part[0] is the existing point of the texel;
 * kiln_surface_add_subtexels fills in the others. */
struct kiln_subtexel_set {
    struct kiln_divided_texel divided;
    uint32_t count;             /* subtexels: 1 to KILN_SUBTEXELS */
    float area[KILN_SUBTEXELS]; /* m2 of each part; not read for part 0, which keeps the rest of the area */
    uint16_t albedo[3];
    uint32_t map, tile, cell; /* lightmap, tile and cell of the texel's tile run */
};

/* Piece: the area of one triangle in one part. */
struct kiln_subtexel_piece {
    uint64_t point; /* as in kiln_subtexel_set.divided.part[0] */
    uint32_t part, triangle;
    double area; /* m2, for area sampling */
};

/* Adds a point for each part but the first. New points follow the other points of their cell (with partition by
 * objects: of the scene), ordered by lightmap, tile in Morton order and bit. So the global order depends on the scene
 * alone, and the points of a rank stay one range: a rank gets the new points of the cells that end within its range.
 * Renumbers all points, and rebuilds tiles, splits and the rank's arrays.
 *
 * Every rank passes all texels and all pieces of the scene, in any order; both lists are sorted. The surface's global
 * arrays must not be shared yet, and it must have no divided texel. Not collective. KILN_SYSTEM; afterwards the surface
 * can only be destroyed. */
int kiln_surface_add_subtexels(struct kiln_surface *surface, struct kiln_subtexel_set *texels, size_t count,
                               struct kiln_subtexel_piece *pieces, size_t piece_count, struct kiln_error *error);

#endif
