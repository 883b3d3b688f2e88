/* The guided pass: the gather pass with directions by the guides of tile runs, and a word of each ray for what it has
 * found (guide.glsl). guided_learn.comp and guided_reduce.comp add up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GUIDED
#include "shaders/gather.glsl"
