/* The gather pass from rows, for the host: the answers of several lights are interleaved. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/replay.glsl"

KILN_ARRAY(ResultArray, kiln_gpu_result, 4);

void put_answer(uint x, uint light, kiln_gpu_result r) { ResultArray(push.results).at[x * LIGHTS + light] = r; }
