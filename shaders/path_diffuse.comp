/* Paths of pixels in scenes with gloss: from the camera or a diffuse surface until they hit gloss. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_WALK_DIFFUSE
#include "shaders/path.glsl"
