/* Sums up the slices of probes.comp, in order: thread (x, y) computes float y of the answer of probe x. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/layout_probe.h"
#include "shaders/sum.glsl"

KILN_PUSH(kiln_gpu_probes_reduce_push);

KILN_ARRAY(FloatArray, float, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count || y >= KILN_GPU_PROBE_FLOATS)
        return;
    kiln_sum sum = kiln_sum(0.0, 0.0);
    for (uint s = 0u; s < push.slice_count; s++)
        kiln_add(sum, FloatArray(push.slices + uint64_t(s * KILN_GPU_PROBE_FLOATS + y) * push.count * 4ul).at[x]);
    FloatArray(push.results).at[x * KILN_GPU_PROBE_FLOATS + y] = sum.high + sum.low;
}

#include "shaders/main.glsl"
