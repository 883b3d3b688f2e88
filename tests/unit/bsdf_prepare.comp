/* Sets the part of lobes that comes from tables of the host, for hits of materials with textures. The rest of
 * kiln_bsdf_prepare_hit is long code without tables. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/bsdf.h"

layout(push_constant, scalar) uniform Push
{
    KILN_ADDRESS scene, lobes;
    kiln_bsdf_tables tables;
    uint count;
}
push;

KILN_ARRAY(Lobes, kiln_bsdf_lobes, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count)
        return;
    kiln_bsdf_lobes l = Lobes(push.lobes).at[x];
    if ((push.tables.brushed_low | push.tables.brushed_high) != 0u && l.base_is_mirror == 0u)
        kiln_bsdf_take_layers(l, push.tables.brushed_low, push.tables.brushed_high);
    if ((push.tables.trapped_low | push.tables.trapped_high) != 0u)
        kiln_bsdf_take_trapped(l, push.tables.trapped_low, push.tables.trapped_high);
    kiln_bsdf_dye(l, l.p.base_color);
    Lobes(push.lobes).at[x] = l;
}

#include "shaders/main.glsl"
