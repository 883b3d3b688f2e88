/* The weighed pass: the rays of the caustic pass, which share its light with light paths. weighed_chains.comp follows
 * the chains of rays that have met gloss, gather_reduce.comp sums up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_CAUSTIC
#define KILN_WEIGHED
#include "shaders/gather.glsl"
