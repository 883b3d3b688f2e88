/* The caustic pass: the rays of the bounce pass, which find lamps and sky by chains of gloss. gather_reduce.comp sums
 * up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_CAUSTIC
#include "shaders/gather.glsl"
