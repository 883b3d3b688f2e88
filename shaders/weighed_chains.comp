/* Chains of the rays of the weighed pass: follow.glsl. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_CAUSTIC
#define KILN_WEIGHED
#include "shaders/follow.glsl"
