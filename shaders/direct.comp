/* The direct pass, second: shadow rays, reckoned in floats; of all choices but those that direct_precise.comp takes. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/direct_rays.glsl"
