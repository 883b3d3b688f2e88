/* Chains of the rays of the gather pass: follow.glsl. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_CHAIN_RADIOSITY
#include "shaders/follow.glsl"
