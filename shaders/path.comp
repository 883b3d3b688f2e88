/* The path pass of scenes without gloss, where light transport treats all materials as diffuse. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/path.glsl"
