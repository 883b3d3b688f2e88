/* Lobes of hits of materials with textures, made ready on the device with the tables that the host has made. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/bsdf.h"

layout(push_constant, scalar) uniform Push
{
    KILN_ADDRESS scene, materials, lobes;
    kiln_bsdf_tables tables;
    uint count;
}
push;

KILN_ARRAY(Materials, kiln_bsdf, 4);
KILN_ARRAY(Lobes, kiln_bsdf_lobes, 4);

void kiln_kernel(uint x, uint y)
{
    if (x < push.count)
        Lobes(push.lobes).at[x] = kiln_bsdf_prepare_hit(Materials(push.materials).at[x], push.tables);
}

#include "shaders/main.glsl"
