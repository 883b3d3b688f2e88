/* Leaves: cubes of equal size, in a grid over the world, for stores that need no lightmap layout. The surface of one
 * object that faces one side and lies in one leaf is one surface point (worker/scene/surface.h).
 *
 * There are six sides: the axis nearest to a triangle's normal, in positive or negative direction (side 2 a: along axis
 * a; 2 a + 1: against it; the first of equally near axes). So the two faces of a wall thinner than a leaf, or the faces
 * of a corner, have points of their own. Depth is measured along this axis; the other two, in cyclic order, are x and
 * y. Projected to x and y, the triangle has area, and a leaf is a square with a range of depths. So the code for texels
 * of lightmaps works for leaves, too, with an additional cut to the range of depths (worker/scene/texel.h).
 *
 * Coordinates are in leaves from leaf_origin on, half a leaf before the scene's bounds, and above 0. A triangle
 * perpendicular to its depth axis lies wholly in one layer of leaves, because depths are rounded to float first, as for
 * ray hits. */
#ifndef KILN_WORKER_SCENE_LEAVES_H
#define KILN_WORKER_SCENE_LEAVES_H

#include "shaders/shared/store_octree.h"
#include "worker/scene/geometry.h"

/* Lays leaves of `size` m over the geometry, once: fills `leaves` and replaces the records' coordinates in lightmaps.
 * KILN_BAD_INPUT for more than 2^21 leaves along a side of the scene; KILN_SYSTEM. */
int kiln_leaves_lay(struct kiln_geometry *geometry, double size, struct kiln_error *error);

/* World axis of a side's coordinate: 0 for x, 1 for y, 2 for depth. */
static inline int kiln_leaf_axis(uint32_t side, int coordinate) { return ((int)(side / 2) + 1 + coordinate) % 3; }

/* Computes a world triangle's corners in leaf coordinates: x, y and depth. */
void kiln_leaf_corners(const struct kiln_geometry *geometry, uint64_t triangle, double corner[3][3]);

#endif
