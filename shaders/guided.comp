/* The guided pass: the gather pass with directions from the guides of tile runs, and a word per ray for its result
 * (guide.glsl). guided_learn.comp and guided_reduce.comp sum up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GUIDED
#include "shaders/gather.glsl"
