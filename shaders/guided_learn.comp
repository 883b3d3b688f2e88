/* Sums up the squares of what a point's rays have found, for each cell of its tile run's guide, in the order of the
 * samples. Values are divided by a power of two near the largest, so that squares fit a float. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_guided_reduce_push);

KILN_ARRAY(GuidedRef, kiln_gpu_guided, 8);
KILN_ARRAY(WordArray, uint, 4);
KILN_ARRAY(FloatArray, float, 4);

uint64_t place(uint64_t array, uint row, uint x) { return array + (uint64_t(row) * push.chunk.total + x) * 4ul; }

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    const kiln_gpu_guided guided = GuidedRef(push.guided).at[0];
    const uint side = kiln_gpu_guide_side(WordArray(guided.words).at[x]);
    if (side == 0u || WordArray(push.chunk.states).at[push.chunk.origin + x] == KILN_GPU_STATE_INVALID)
        return;
    for (uint c = 0u; c < side * side; c++)
        FloatArray(place(guided.squares, c, x)).at[0] = 0.0;
    float most = 0.0;
    uint k = 0u;
    for (; k < push.samples; k++)
        most = max(most, kiln_gpu_guide_luminance(WordArray(place(guided.rays, k, x)).at[0]));
    bool good = k >= push.samples;
    int exponent;
    frexp(most, exponent);
    exponent = clamp(exponent, -126, 126);
    const float down = ldexp(1.0, -exponent);
    for (k = 0u; k < push.samples; k++) {
        const uint ray = WordArray(place(guided.rays, k, x)).at[0];
        const float found = down * kiln_gpu_guide_luminance(ray);
        FloatArray cell = FloatArray(place(guided.squares, kiln_gpu_guide_cell(ray), x));
        cell.at[0] += found * found;
    }
    good = good && k >= push.samples;
    WordArray(guided.exponents).at[x] = good ? uint(exponent + KILN_GPU_GUIDE_BIAS) : KILN_GPU_NONE;
}

#include "shaders/main.glsl"
