/* Radiosity at a hit. The way there is the store's (worker/store/store.h), which the constant HAS_OCTREE chooses. It
 * gives
 *
 *   kiln_store_way         what a hit leads to: the hit record's `object` and `material`, and the store's own
 *   kiln_store_enter       that of a hit (u, v) on a world triangle; `back`: of a triangle with two sides
 *   kiln_store_radiosity   radiosity there, W/m2; 0 beside every place */
#ifndef KILN_SHADERS_SURFACE_GLSL
#define KILN_SHADERS_SURFACE_GLSL

#include "shaders/radiosity.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer RecordHalves { vec4 at[]; };
KILN_ARRAY(RadiosityWords, uvec2, 8);

#include "shaders/store_lightmap.glsl"

#endif
