/* The gather pass of bakes that keep the hits of rays: the same sums, and a word for each ray (kept_rows.glsl). */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_KEEP
#include "shaders/gather.glsl"
