/* The direct pass, step 3, on devices with doubles: shadow rays of choices that need more than float precision; their
 * light is added to the sums of the others. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_PRECISE
#include "shaders/direct_rays.glsl"
