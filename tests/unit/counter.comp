/* A kernel for tests of the device layer: adds x + 3 y + STEP to each of width x height words, from one array to
 * another. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

layout(constant_id = 6) const uint STEP = 0u;

KILN_ARRAY(Words, uint, 4);

layout(push_constant, scalar) uniform Push
{
    KILN_ADDRESS scene;
    KILN_ADDRESS from, to;
    uint width, height;
} push;

void kiln_kernel(uint x, uint y)
{
    if (x >= push.width || y >= push.height)
        return;
    const uint i = y * push.width + x;
    Words(push.to).at[i] = Words(push.from).at[i] + x + 3u * y + STEP;
}

#include "shaders/main.glsl"
