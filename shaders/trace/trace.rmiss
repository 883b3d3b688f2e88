#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/trace/payload.glsl"

layout(location = 0) rayPayloadInEXT kiln_payload kiln_answer;

void main() { kiln_answer.triangle_back = KILN_GPU_NONE; }
