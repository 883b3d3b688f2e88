/* Which surfaces enclose opaque matter: nothing can be seen of their backs, whatever a material says of its sides.
 *
 * A solid is a piece of a mesh, connected through edges, that is closed (every edge is passed as often one way as the
 * other, so that the winding number of any point is a whole number), turned outwards (its volume is positive), opaque
 * in all its triangles, and dark inside: no punctual light and no emitting surface of another piece lies in it, and
 * none of its own triangles emits on both sides. No light ever gets in, so a back of it receives and sends none. A room
 * modelled as a box around a lamp is none, nor is an open sheet.
 *
 * Corners at equal positions of the mesh are one vertex. An emitting object is looked at in KILN_SOLID_EMITTERS places.
 */
#ifndef KILN_WORKER_SCENE_SOLIDS_H
#define KILN_WORKER_SCENE_SOLIDS_H

#include "worker/scene/geometry.h"

enum { KILN_SOLID_EMITTERS = 256 };

/* Takes KILN_RECORD_DOUBLE_SIDED from the records of all triangles of solids. The geometry is otherwise complete. Not
 * collective. Uses as many OpenMP threads as are set; the result does not depend on it. KILN_SYSTEM. */
int kiln_solids_close(struct kiln_geometry *geometry, const struct kiln_scene *scene, struct kiln_error *error);

#endif
