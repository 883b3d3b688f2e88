/* Solids: surfaces that enclose opaque matter. Their backs are never visible, even if a material is double-sided.
 *
 * A solid is a piece of a mesh, connected through edges, with four properties. It is closed: every edge is traversed as
 * often one way as the other, so that the winding number of any point is a whole number. It is turned outwards: its
 * volume is positive. All its triangles are opaque. It is dark inside: no punctual light and no emitting surface of
 * another piece lies in it, and none of its own triangles emits on both sides. No light ever gets in, so its back
 * receives and sends none. A room modelled as a box around a lamp is no solid, nor is an open sheet.
 *
 * Corners at equal positions of the mesh count as one vertex. An emitting object is represented by KILN_SOLID_EMITTERS
 * positions on it. */
#ifndef KILN_WORKER_SCENE_SOLIDS_H
#define KILN_WORKER_SCENE_SOLIDS_H

#include "worker/scene/geometry.h"

enum { KILN_SOLID_EMITTERS = 256 };

/* Clears KILN_RECORD_DOUBLE_SIDED in the records of all triangles of solids. The geometry must be complete otherwise.
 * Not collective. Uses as many OpenMP threads as are set; the result does not depend on their number. KILN_SYSTEM. */
int kiln_solids_make_one_sided(struct kiln_geometry *geometry, const struct kiln_scene *scene,
                               struct kiln_error *error);

#endif
