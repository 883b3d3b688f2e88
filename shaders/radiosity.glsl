/* Packed radiosity as a colour (shaders/shared/radiosity.h). */
#ifndef KILN_SHADERS_RADIOSITY_GLSL
#define KILN_SHADERS_RADIOSITY_GLSL

#include "shaders/shared/radiosity.h"

vec3 kiln_radiosity_unpack(uvec2 packed)
{
    return uintBitsToFloat(
        uvec3(kiln_radiosity_red(packed.x), kiln_radiosity_green(packed.x, packed.y), kiln_radiosity_blue(packed.y)));
}

#endif
