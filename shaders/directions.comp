/* The directions pass: the gather pass with ray directions from a set (directions.glsl). gather_reduce.comp sums up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_DIRECTIONS
#include "shaders/gather.glsl"
