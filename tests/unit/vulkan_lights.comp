/* Lights in double. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "tests/unit/vulkan_lights.glsl"
