/* The direct pass, second: shadow rays, reckoned in floats where the device has doubles, else for all choices: shaders/direct_rays.glsl. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/direct_rays.glsl"
