/* Triangles that let light through somewhere: by an alpha mask, by blending or by transmission. A hit on their backs
 * does not mean that a ray is inside a solid, since light gets behind them.
 *
 * The test reads only the texels that a triangle may show. So the walls of a house do not count as open because the
 * material's texture has holes elsewhere. The test is conservative: texels a little outside the triangle may count as
 * holes, too. */
#ifndef KILN_WORKER_SCENE_HOLES_H
#define KILN_WORKER_SCENE_HOLES_H

#include "worker/scene/geometry.h"

/* Sets KILN_RECORD_CLEAR in the records of all such triangles. Not collective. Uses as many OpenMP threads as are set;
 * the result does not depend on their number. Needs, while it works, 4/3 bytes for each texel of the textures of
 * materials that are not opaque. KILN_SYSTEM. */
int kiln_holes_mark(struct kiln_geometry *geometry, const struct kiln_scene *scene, struct kiln_error *error);

#endif
