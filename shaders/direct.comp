/* The direct pass, step 2: shadow rays computed in floats, for all choices except those of direct_precise.comp. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/direct_rays.glsl"
