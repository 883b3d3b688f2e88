/* The parts of texels that walls divide, as surface points of their own (struct kiln_divided_texel of
 * worker/scene/surface.h): from a list of divided texels to the surface that has them. */
#ifndef KILN_COORDINATOR_SURFACE_PARTS_H
#define KILN_COORDINATOR_SURFACE_PARTS_H

#include "worker/scene/surface.h"

/* A divided texel. `divided` is complete but for the numbers of points: part[0] is the point that the texel has so far,
 * the others are found here. */
struct kiln_parted_texel {
    struct kiln_divided_texel divided;
    uint32_t count;               /* parts: 1 to KILN_TEXEL_PARTS */
    float area[KILN_TEXEL_PARTS]; /* m2 of each part; that of part 0 is not read: it keeps the rest of its point's */
    uint16_t albedo[3];
    uint32_t map, tile, cell; /* of its tile run */
};

/* A triangle of which a part has something. */
struct kiln_parted_piece {
    uint64_t point; /* as in kiln_parted_texel.divided.part[0] */
    uint32_t part, triangle;
    double area; /* m2, of what samples are drawn from */
};

/* Adds a point for each part but the first: after the other points of its cell (with partition by objects: of the
 * scene), by lightmap, tile in Morton order and bit. So the global order hangs on the scene alone, and a rank's points
 * stay one range: it gets those of the cells that end within it. Numbers of all points, tiles, splits and the rank's
 * arrays are made anew.
 *
 * Every rank calls with all texels and all pieces of the scene, each list in any order; both are sorted. The surface's
 * global arrays must not be shared yet, and it must have no divided texel. Not collective. KILN_SYSTEM: the surface can
 * only be destroyed then. */
int kiln_surface_add_parts(struct kiln_surface *surface, struct kiln_parted_texel *texels, size_t count,
                           struct kiln_parted_piece *pieces, size_t piece_count, struct kiln_error *error);

#endif
