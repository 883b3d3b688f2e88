/* The lightmap as a store (worker/store/store.h), in both languages: from a hit to a texel. */
#ifndef KILN_SHADERS_SHARED_STORE_LIGHTMAP_H
#define KILN_SHADERS_SHARED_STORE_LIGHTMAP_H

#include "shaders/shared/language.h"

/* One coordinate of a hit on its object's lightmap, in texels. `corner`, `along_u` and `along_v` are that coordinate's
 * entries of the triangle's hit record: at corner 0, and from there to corners 1 and 2. u and v are the hit's
 * barycentric weights of those corners. */
KILN_FUNCTION float kiln_texel_coordinate(float corner, float along_u, float along_v, float u, float v)
{
    return corner + u * along_u + v * along_v;
}

/* Column or row of the texel at a coordinate, from 0 to `last`: rounding may put a hit at the border a little outside.
 */
KILN_FUNCTION KILN_I32 kiln_texel_of(float coordinate, KILN_I32 last)
{
    return integer_clamp(KILN_TO_I32(coordinate), 0, last);
}

#endif
