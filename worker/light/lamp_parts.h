/* Parts of emitting triangles with uneven textures. Each part has about the same radiance all over and is an area light
 * of its own, so that a bright spot in a large dark texture is sampled like a small lamp.
 *
 * A triangle is bisected at the middle of its longest edge, its parts at the edge opposite the newest vertex (newest
 * vertex bisection). The part whose light is spread most unevenly is cut first. Parts without any light are left out.
 */
#ifndef KILN_WORKER_LIGHT_LAMP_PARTS_H
#define KILN_WORKER_LIGHT_LAMP_PARTS_H

#include "worker/light/lights.h"

enum { KILN_LAMP_PARTS = 1 << 16 };

/* Replaces the area lights that are `textured` by their parts, ordered by triangle, then by path of bisection. At most
 * KILN_LAMP_PARTS parts are added; dark parts are dropped. Sets triangle_count and textured_count. Uses
 * lights->textures. Not collective. KILN_SYSTEM. */
int kiln_lamp_parts_cut(struct kiln_lights *lights, struct kiln_error *error);

#endif
