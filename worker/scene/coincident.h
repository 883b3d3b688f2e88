/* Search for coincident faces, of which rounding decides which one a ray hits. */
#ifndef KILN_WORKER_SCENE_COINCIDENT_H
#define KILN_WORKER_SCENE_COINCIDENT_H

#include "worker/scene/geometry.h"

/* Searches the geometry for two kinds of coincident triangles. First, triangles that face opposite ways, at least one
 * of them single-sided (geometry->coincident). Second, opaque triangles with the same lit sides: both face the same
 * way, or both are double-sided (doubled_area, doubled). Two triangles count as coincident if they share their shortest
 * edge, corner for corner, and lie in one plane (within KILN_COINCIDENT of the extent) on the same side of that edge.
 * So sheets with equal triangles are found, and parallelograms with equal corners cut along different diagonals, unless
 * a diagonal is shorter than a side. Faces that overlap in part without such a pair are not found. At most 64 triangles
 * with the same shortest edge are compared. So doubled_area is a lower bound. Writes only these three members of the
 * geometry, which is borrowed.
 *
 * Not collective. Uses all threads; the result does not depend on them. 28 bytes a triangle while it works, and 8 for
 * each pair found. KILN_SYSTEM. */
int kiln_coincident_find(struct kiln_geometry *geometry, struct kiln_error *error);

#endif
