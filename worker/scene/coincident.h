/* Two faces that coincide: which of them a ray meets is decided by rounding. */
#ifndef KILN_WORKER_SCENE_COINCIDENT_H
#define KILN_WORKER_SCENE_COINCIDENT_H

#include "worker/scene/geometry.h"

/* Finds whether the geometry has two triangles that coincide and look opposite ways, one of which at least is
 * single-sided (geometry->coincident); and opaque triangles that coincide and of which the same sides are lit, those
 * that look the same way or are double-sided both (doubled_area, doubled). What it finds: two triangles with the same
 * shortest edge, corner for corner, that lie in one plane (KILN_COINCIDENT of the extent) on the same side of that
 * edge. So it finds sheets with equal triangles, and parallelograms with equal corners that are cut along
 * different diagonals, unless a diagonal is shorter than a side. It does not find faces that overlap in part and have
 * no such pair. Of more than 64 triangles with the same shortest edge the others are not looked at. So doubled_area is
 * a lower bound. The geometry is borrowed; those three members of it are written.
 *
 * Not collective. Uses all threads; the result does not depend on them. 28 bytes a triangle while it works, and 8 for
 * each pair found. KILN_SYSTEM. */
int kiln_coincident_find(struct kiln_geometry *geometry, struct kiln_error *error);

#endif
