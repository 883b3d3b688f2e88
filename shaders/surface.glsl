/* Radiosity at a hit. The store (worker/store/store.h), selected by the constant HAS_OCTREE, provides
 *
 *   kiln_store_way         place of a hit in the store: the hit record's `object` and `material`, and the store's own
 * data
 *   kiln_store_enter       finds it for a hit (u, v) on a world triangle; `back`: on the back of a two-sided triangle
 *   kiln_store_radiosity   radiosity there, W/m2; 0 if there is no point */
#ifndef KILN_SHADERS_SURFACE_GLSL
#define KILN_SHADERS_SURFACE_GLSL

#include "shaders/radiosity.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer RecordHalves { vec4 at[]; };
KILN_ARRAY(RadiosityWords, uvec2, 8);

#include "shaders/store_lightmap.glsl"

#endif
