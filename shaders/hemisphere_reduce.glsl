/* Sums up the slices of hemisphere.glsl, one after the other. Slices of partly buried points are in all rows, those of
 * other points in each `split`-th row. Before it stand three constants: FLOATS, the number of floats of a slice;
 * MOST_FLOATS, a literal, the largest such number; MEASURED, the float whose sums over quarters are wanted
 * (KILN_GPU_NONE: none). Constants let the compiler unroll the loops and keep the sums in registers.
 * HEMISPHERE_REDUCE_PUSH may name other push constants with the same members. */
#ifndef HEMISPHERE_REDUCE_PUSH
#    define HEMISPHERE_REDUCE_PUSH kiln_gpu_hemisphere_reduce_push
#endif
#include "shaders/totals.glsl"

KILN_PUSH(HEMISPHERE_REDUCE_PUSH);

KILN_ARRAY(PointArray, kiln_gpu_point, 8);
KILN_ARRAY(WordArray, uint, 4);
KILN_ARRAY(FloatArray, float, 4);

/* False for an invalid point. */
bool hemisphere_totals(uint x, out Totals totals)
{
    const uint state = WordArray(push.chunk.states).at[push.chunk.origin + x];
    const uint rows = push.per_quarter * push.split, step = state == KILN_GPU_STATE_BURIED ? 1u : push.split;
    kiln_sum sums[MOST_FLOATS];
    for (uint c = 0u; c < MOST_FLOATS; c++) {
        sums[c] = kiln_sum(0.0, 0.0);
        totals.sum[c] = 0.0;
    }
    for (uint q = 0u; q < 4u; q++)
        totals.quarters[q] = 0.0;
    if (state == KILN_GPU_STATE_INVALID)
        return false;
    for (uint q = 0u; q < 4u; q++) {
        kiln_sum quarter = kiln_sum(0.0, 0.0);
        for (uint i = 0u; i < rows; i += step) {
            const uint64_t row = uint64_t((q * rows + i) * FLOATS) * push.chunk.total * 4ul;
            FloatArray slice = FloatArray(push.slices + row);
            for (uint c = 0u; c < MOST_FLOATS; c++)
                if (c < FLOATS)
                    kiln_add(sums[c], slice.at[c * push.chunk.total + x]);
            if (MEASURED != KILN_GPU_NONE)
                kiln_add(quarter, slice.at[MEASURED * push.chunk.total + x]);
        }
        totals.quarters[q] = float_of(quarter);
    }
    for (uint c = 0u; c < MOST_FLOATS; c++)
        totals.sum[c] = float_of(sums[c]);
    return true;
}
