/* Sums up the rows of links.comp, one after the other; zeros for invalid points. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_links_reduce_push);

#include "shaders/position.glsl"
#include "shaders/sum.glsl"

KILN_ARRAY(LinkedPoints, kiln_gpu_linked_point, 4);
KILN_ARRAY(LinkRuns, kiln_gpu_link_run, 4);
KILN_ARRAY(FloatArray, float, 4);
KILN_ARRAY(ResultArray, kiln_gpu_link_sums, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    const uint index = push.chunk.origin + x;
    const uint state = WordArray(push.chunk.states).at[index] & KILN_GPU_STATE_MASK;
    kiln_sum sums[KILN_GPU_LINK_FLOATS];
    for (uint c = 0u; c < KILN_GPU_LINK_FLOATS; c++)
        sums[c] = kiln_sum(0.0, 0.0);
    const kiln_gpu_linked_point own = LinkedPoints(push.points).at[x];
    const kiln_gpu_link_run run = LinkRuns(push.runs).at[own.run_and_bit >> 6];
    const uint links = state == KILN_GPU_STATE_INVALID ? 0u : run.count + run.tinted_count;
    const uint rows = (links + KILN_GPU_LINKS_A_ROW - 1u) / KILN_GPU_LINKS_A_ROW;
    uint r = 0u;
    bool good = true;
    for (; r < rows; r++) {
        FloatArray floats = FloatArray(push.slices + uint64_t(r * KILN_GPU_LINK_FLOATS) * push.chunk.total * 4ul);
        for (uint c = 0u; c < KILN_GPU_LINK_FLOATS; c++)
            kiln_add(sums[c], floats.at[c * push.chunk.total + x]);
        good = good && floats.at[6u * push.chunk.total + x] >= 0.0;
    }
    kiln_gpu_link_sums result;
    const vec3 shading = kiln_shading(PointArray(push.chunk.points).at[index], own.normal);
    for (uint c = 0u; c < 3u; c++) {
        result.incident[c] = sums[c].high + sums[c].low;
        result.irradiance[c] = sums[3u + c].high + sums[3u + c].low;
        result.shading[c] = shading[c];
    }
    result.row = good && r >= rows ? sums[6].high + sums[6].low : -1.0;
    result.variance = sums[7].high + sums[7].low;
    ResultArray(push.results).at[x] = result;
}

#include "shaders/main.glsl"
