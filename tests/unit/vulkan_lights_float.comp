/* Lights in float. */
#version 460
#extension GL_GOOGLE_include_directive : require
#undef KILN_FLOAT64
#include "tests/unit/vulkan_lights.glsl"
