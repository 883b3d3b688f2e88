/* Adds up what gather.comp found, slice after slice, and makes each point's answer of it; zeros for invalid points. The
 * slices of partly buried points fill all rows, those of other points each `split`-th. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/sum.glsl"

KILN_PUSH(kiln_gpu_gather_reduce_push);

KILN_ARRAY(PointArray, kiln_gpu_point, 8);
KILN_ARRAY(WordArray, uint, 4);
KILN_ARRAY(FloatArray, float, 4);
KILN_ARRAY(ResultArray, kiln_gpu_result, 4);

const uint SLICE_FLOATS = HAS_ALPHA == KILN_PASSAGE_TINT ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS;

float mean(kiln_sum sum, float count) { return (sum.high + sum.low) / count; }

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    const uint index = push.chunk.origin + x;
    kiln_gpu_result r =
        kiln_gpu_result(float[3](0.0, 0.0, 0.0), float[3](0.0, 0.0, 0.0), 0.0, 0.0, 0.0, float[3](0.0, 0.0, 0.0), 0.0);
    const uint state = WordArray(push.chunk.states).at[index];
    if (state != KILN_GPU_STATE_INVALID) {
        const uint rows = push.per_quarter * push.split, step = state == KILN_GPU_STATE_BURIED ? 1u : push.split;
        const float n = float(push.samples);
        kiln_sum sums[8], glass[3];
        for (uint c = 0u; c < 8u; c++)
            sums[c] = kiln_sum(0.0, 0.0);
        for (uint c = 0u; c < 3u; c++)
            glass[c] = kiln_sum(0.0, 0.0);
        float quarters[4];
        for (uint q = 0u; q < 4u; q++) {
            kiln_sum luminance = kiln_sum(0.0, 0.0);
            for (uint i = 0u; i < rows; i += step) {
                const uint64_t row = uint64_t((q * rows + i) * SLICE_FLOATS) * push.chunk.total * 4ul;
                FloatArray slice = FloatArray(push.slices + row);
                for (uint c = 0u; c < 8u; c++)
                    kiln_add(sums[c], slice.at[c * push.chunk.total + x]);
                for (uint c = 0u; c < 3u && HAS_ALPHA == KILN_PASSAGE_TINT; c++)
                    kiln_add(glass[c], slice.at[(9u + c) * push.chunk.total + x]);
                kiln_add(luminance, slice.at[8u * push.chunk.total + x]);
            }
            quarters[q] = mean(luminance, 0.25 * n);
        }
        for (uint c = 0u; c < 3u; c++) {
            r.incident[c] = mean(sums[c], n);
            r.irradiance[c] = mean(sums[3u + c], n);
            r.glass[c] = mean(glass[c], n);
        }
        r.escaped = mean(sums[6], n);
        r.blocked = mean(sums[7], n);
        /* Standard error of the mean of four sub-nets: more than the error of the whole net, whose parts balance one
         * another. */
        if (push.samples >= 4u) {
            const float middle = 0.25 * (quarters[0] + quarters[1] + quarters[2] + quarters[3]);
            float square = 0.0;
            for (uint q = 0u; q < 4u; q++)
                square += (quarters[q] - middle) * (quarters[q] - middle);
            r.error = sqrt(square / 12.0);
        }
        if (r.escaped < 0.0)
            r.error = -1.0; /* the answer is not good */
        r.present = PointArray(push.chunk.points).at[index].present;
    }
    ResultArray(push.results).at[x] = r;
}

#include "shaders/main.glsl"
