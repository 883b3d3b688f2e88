/* Adds up the slices of one light of replay.comp; answers of several lights lie side by side. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

#define GATHER_ANSWER(x, r) ResultArray(push.results).at[(x)*push.stride] = r
KILN_ARRAY(ResultArray, kiln_gpu_result, 4);
#include "shaders/gather_reduce.glsl"
