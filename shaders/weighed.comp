/* The rays of the weighed pass: the caustic pass's, of whose light light paths have a part. weighed_chains.comp follows
 * those that have met gloss, gather_reduce.comp adds up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_CAUSTIC
#define KILN_WEIGHED
#include "shaders/gather.glsl"
