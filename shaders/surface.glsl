/* Radiosity at a hit. The way there is the store's (worker/store/store.h), which the constant HAS_OCTREE chooses. It
 * gives
 *
 *   kiln_store_way         what a hit leads to: the hit record's `object` and `material`, and the store's own
 *   kiln_store_enter       that of a hit (u, v) on a world triangle; `back`: of a triangle with two sides
 *   kiln_store_radiosity   radiosity there, W/m2; 0 beside every place */
#ifndef KILN_SHADERS_SURFACE_GLSL
#define KILN_SHADERS_SURFACE_GLSL

#include "shaders/shared/radiosity.h"

layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer RecordHalves { vec4 at[]; };
KILN_ARRAY(RadiosityWords, uvec2, 8);

vec3 kiln_radiosity_unpack(uvec2 packed)
{
    return uintBitsToFloat(uvec3(kiln_radiosity_red(packed.x), kiln_radiosity_green(packed.x, packed.y),
                                 kiln_radiosity_blue(packed.y)));
}

#include "shaders/store_lightmap.glsl"

#endif
