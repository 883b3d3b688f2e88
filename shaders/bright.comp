/* The directions pass with rays to bright patches: the gather pass, with some samples directed to patches
 * (bright.glsl). gather_reduce.comp sums up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_DIRECTIONS
#define KILN_BRIGHT
#include "shaders/gather.glsl"
