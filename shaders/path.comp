/* The path pass where light transport takes all materials as diffuse. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/path.glsl"
