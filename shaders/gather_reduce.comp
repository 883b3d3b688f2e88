#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

#include "shaders/gather_reduce.glsl"
