/* The weighed pass: the caustic pass's rays, of whose light light paths have a part. gather_reduce.comp adds up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_CAUSTIC
#define KILN_WEIGHED
#include "shaders/gather.glsl"
