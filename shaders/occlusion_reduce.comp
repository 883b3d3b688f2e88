/* Adds up what occlusion.comp found and makes each point's answer of it; zeros for invalid points. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

const uint MOST_FLOATS = KILN_GPU_OCCLUSION_FLOATS;
#include "shaders/hemisphere_reduce.glsl"

KILN_ARRAY(ResultArray, kiln_gpu_occlusion_result, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    kiln_gpu_occlusion_result r = kiln_gpu_occlusion_result(0.0, float[3](0.0, 0.0, 0.0), 0.0);
    Totals totals;
    if (hemisphere_totals(x, KILN_GPU_OCCLUSION_FLOATS, 0u, totals)) {
        /* Shading normals give samples weights whose mean is 1 but for noise: no more than everything is open. */
        const float n = max(float(push.samples), totals.sum[0]);
        r.open = totals.sum[0] / n;
        for (uint c = 0u; c < 3u; c++)
            r.direction[c] = clamp(totals.sum[1u + c] / n, -1.0, 1.0); /* the last bit may be above */
        r.error = r.open < 0.0 ? -1.0 : totals.error; /* -1: the answer is not good */
    }
    ResultArray(push.results).at[x] = r;
}

#include "shaders/main.glsl"
