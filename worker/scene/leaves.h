/* Leaves: cubes of equal size, in a grid over the world, for stores that need no lightmap layout. Of the surface of one
 * object that looks to one side, what lies in one leaf is one surface point (worker/scene/surface.h).
 *
 * The sides are six: along the axis that a triangle's normal is nearest to, up or down it (side 2 a: up axis a; 2 a +
 * 1: down; of axes that are equally near the first). So the two faces of a wall thinner than a leaf, or the faces of a
 * corner, have points of their own. The axis is the triangle's depth; the other two, in cyclic order, are its x and y.
 * Over x and y a triangle is a triangle with area, and a leaf is a square with a range of depths: so what lightmaps do
 * with a texel's square serves for leaves, but for the cut to the range of depths (worker/scene/texel.h).
 *
 * Coordinates are in leaves from leaf_origin on, half a leaf before the scene's bounds, and above 0. A flat triangle
 * across its depth lies in one layer of leaves wholly: depths are rounded to float first, as rays find them. */
#ifndef KILN_WORKER_SCENE_LEAVES_H
#define KILN_WORKER_SCENE_LEAVES_H

#include "shaders/shared/store_octree.h"
#include "worker/scene/geometry.h"

/* Lays leaves of `size` m over the geometry, once: fills `leaves` and replaces the records' coordinates in lightmaps.
 * KILN_BAD_INPUT if more than 2^21 of them would lie along a side of the scene; KILN_SYSTEM. */
int kiln_leaves_lay(struct kiln_geometry *geometry, double size, struct kiln_error *error);

/* The axes of a side: of x, y and depth. */
static inline int kiln_leaf_axis(uint32_t side, int coordinate) { return ((int)(side / 2) + 1 + coordinate) % 3; }

/* A world triangle's corners among leaves: x, y and depth. */
void kiln_leaf_corners(const struct kiln_geometry *geometry, uint64_t triangle, double corner[3][3]);

#endif
