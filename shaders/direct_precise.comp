/* The direct pass, third, where the device has doubles: shadow rays of the choices that floats would not do for, added
 * to the others' sums. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_PRECISE
#include "shaders/direct_rays.glsl"
