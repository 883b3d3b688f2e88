/* Adds up the slices of light y of replay.comp; answers of several lights lie side by side. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

uint light;
#define HEMISPHERE_REDUCE_PUSH kiln_gpu_replay_reduce_push
#define HEMISPHERE_SLICES (push.slices + uint64_t(light) * push.light_bytes)
#define GATHER_KERNEL
#include "shaders/gather_reduce.glsl"

KILN_ARRAY(ResultArray, kiln_gpu_result, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    kiln_gpu_result r;
    light = y;
    gather_result(x, r);
    ResultArray(push.results).at[x * push.lights + y] = r;
}

#include "shaders/main.glsl"
