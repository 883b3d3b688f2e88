/* Sums up the rows of patches.comp, one after the other; zeros for invalid points. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/sum.glsl"

KILN_PUSH(kiln_gpu_patches_reduce_push);
KILN_ARRAY(WordArray, uint, 4);
KILN_ARRAY(FloatArray, float, 4);
KILN_ARRAY(ResultArray, kiln_gpu_patch_sums, 4);

const uint SUMS = KILN_GPU_PATCH_FLOATS - 1u;

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    const uint state = WordArray(push.chunk.states).at[push.chunk.origin + x] & KILN_GPU_STATE_MASK;
    kiln_sum sums[SUMS];
    for (uint c = 0u; c < SUMS; c++)
        sums[c] = kiln_sum(0.0, 0.0);
    uint pairs[KILN_GPU_PAIRS_WORDS] = {0u, 0u, 0u};
    uint r = 0u;
    bool good = true;
    for (; state != KILN_GPU_STATE_INVALID && r < push.rows; r++) {
        FloatArray floats = FloatArray(push.slices + uint64_t(r * KILN_GPU_PATCH_FLOATS) * push.chunk.total * 4ul);
        for (uint c = 0u; c < SUMS; c++)
            kiln_add(sums[c], floats.at[c * push.chunk.total + x]);
        const float counts = floats.at[SUMS * push.chunk.total + x];
        good = good && counts >= 0.0;
        uint left = uint(max(counts, 0.0));
        for (uint i = 0u; i < KILN_GPU_PAIRS_WORDS; i++, left /= KILN_GPU_PAIRS_BASE)
            pairs[i] += left % KILN_GPU_PAIRS_BASE;
    }
    kiln_gpu_patch_sums result;
    for (uint c = 0u; c < 3u; c++) {
        result.incident[c] = sums[c].high + sums[c].low;
        result.irradiance[c] = sums[3u + c].high + sums[3u + c].low;
    }
    result.row = sums[6].high + sums[6].low;
    if (!good || (state != KILN_GPU_STATE_INVALID && r < push.rows))
        result.row = -1.0;
    ResultArray(push.results).at[x] = result;
    for (uint i = 0u; i < KILN_GPU_PAIRS_WORDS; i++)
        WordArray(push.rays).at[KILN_GPU_PAIRS_WORDS * x + i] = pairs[i];
}

#include "shaders/main.glsl"
