/* Sums up the slices of occlusion.comp to each point's answer; zeros for invalid points. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/streams.h"

const uint FLOATS = KILN_GPU_OCCLUSION_FLOATS, MOST_FLOATS = FLOATS, MEASURED = 0u;
#include "shaders/hemisphere_reduce.glsl"

KILN_ARRAY(ResultArray, kiln_gpu_occlusion_result, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    kiln_gpu_occlusion_result r = kiln_gpu_occlusion_result(0.0, float[3](0.0, 0.0, 0.0), 0.0, 0u);
    Totals totals;
    if (hemisphere_totals(x, totals)) {
        const uint n = push.samples;
        r.open = totals.sum[0];
        for (uint c = 0u; c < 3u; c++) /* rounding of a single direction may exceed 1 */
            r.direction[c] = clamp(totals.sum[1u + c], -float(n), float(n));
        r.count = n;
        for (uint q = 0u; q < 4u; q++)
            totals.quarters[q] /= float(max(1u, kiln_quarter_first(q + 1u, n) - kiln_quarter_first(q, n)));
        if (n >= 4u)
            r.error = float(n) * quarters_error(totals.quarters);
        if (r.open < 0.0)
            r.error = -1.0; /* the answer is not good */
    }
    ResultArray(push.results).at[x] = r;
}

#include "shaders/main.glsl"
