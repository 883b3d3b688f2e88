/* Sums up the slices of directional.comp to each point's answer; zeros for invalid points. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

const uint FLOATS = KILN_GPU_DIRECTIONAL_FLOATS, MOST_FLOATS = FLOATS, MEASURED = KILN_GPU_NONE;
#include "shaders/hemisphere_reduce.glsl"

KILN_ARRAY(ResultArray, kiln_gpu_directional_result, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    Totals totals;
    kiln_gpu_directional_result r;
    r.count = hemisphere_totals(x, totals) ? push.samples : 0u;
    for (uint c = 0u; c + 1u < KILN_GPU_DIRECTIONAL_FLOATS; c++)
        r.radiance[c] = float(r.count) * totals.sum[c];
    ResultArray(push.results).at[x] = r;
    WordArray(push.rays).at[x] = uint(totals.sum[KILN_GPU_DIRECTIONAL_FLOATS - 1u]);
}

#include "shaders/main.glsl"
