/* Parts of emitting triangles whose textures make some places of them brighter than others: lights of their own, each
 * about as bright all over, so that a bright spot in a large dark texture is found as a small lamp is.
 *
 * A triangle is cut in two where its longest edge has its middle, and its parts again at the edge across from the last
 * cut (newest vertex bisection), those first whose light is spread most unevenly. Parts without any light are left
 * out. */
#ifndef KILN_WORKER_LIGHT_LAMP_PARTS_H
#define KILN_WORKER_LIGHT_LAMP_PARTS_H

#include "worker/light/lights.h"

enum { KILN_LAMP_PARTS = 1 << 16 };

/* Puts parts in the place of the area lights that are `textured`, in the order of triangles, then of their paths; no
 * more than KILN_LAMP_PARTS in addition to the triangles; those that are dark all over have none. Sets the numbers of
 * triangles. Uses lights->textures. Not collective. KILN_SYSTEM. */
int kiln_lamp_parts_cut(struct kiln_lights *lights, struct kiln_error *error);

#endif
