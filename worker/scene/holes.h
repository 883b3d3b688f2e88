/* Triangles that let light through somewhere: by an alpha mask, by blending or by transmission. Their backs are no sign
 * of a solid, for what lies behind them is lit.
 *
 * Whether a triangle does is read from the texels that it may show, so that the walls of a house do not count as open
 * because its material's texture has holes elsewhere. The answer errs to the side of letting through: texels a little
 * beside the triangle may count. */
#ifndef KILN_WORKER_SCENE_HOLES_H
#define KILN_WORKER_SCENE_HOLES_H

#include "worker/scene/geometry.h"

/* Sets KILN_RECORD_CLEAR in the records of all such triangles. Not collective. Uses as many OpenMP threads as are set;
 * the result does not depend on their number. Needs, while it works, 4/3 bytes for each texel of the textures of
 * materials that are not opaque. KILN_SYSTEM. */
int kiln_holes_mark(struct kiln_geometry *geometry, const struct kiln_scene *scene, struct kiln_error *error);

#endif
