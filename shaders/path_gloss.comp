/* The path pass where light transport takes some materials with their gloss. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS
#include "shaders/path.glsl"
