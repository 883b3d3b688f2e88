/* The gather pass from rows, for the light of groups of lights. Writes GROUP_FLOATS floats per group: incident light,
 * and irradiance if it differs. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define LIGHTS_THERE push.groups
#define ROW_POINTS push.points
#include "shaders/replay.glsl"

const uint GROUP_FLOATS = HAS_SMOOTH != 0u ? 6u : 3u;

KILN_ARRAY(FloatArray, float, 4);

void put_answer(uint x, uint light, kiln_gpu_result r)
{
    FloatArray floats = FloatArray(push.results + uint64_t(x) * uint64_t(4u * GROUP_FLOATS * push.groups));
    for (uint c = 0u; c < GROUP_FLOATS; c++)
        floats.at[light * GROUP_FLOATS + c] = c < 3u ? r.incident[c] : r.irradiance[c - 3u];
}
