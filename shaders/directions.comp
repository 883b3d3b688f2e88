/* The directions pass: the gather pass with rays by a set of directions (directions.glsl). gather_reduce.comp adds up.
 */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_DIRECTIONS
#include "shaders/gather.glsl"
