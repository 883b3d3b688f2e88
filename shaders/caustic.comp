/* The caustic pass: what the rays of the bounce pass find of lamps and sky in chains. gather_reduce.comp adds up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_CAUSTIC
#include "shaders/gather.glsl"
