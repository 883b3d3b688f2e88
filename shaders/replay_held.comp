/* The gather pass from rows, for light that stays on the device. Writes the part of the answers that replay_take.comp
 * needs: float c of point x under light l at (c * total + x) * LIGHTS + l. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/replay.glsl"

KILN_ARRAY(FloatArray, float, 4);

void put_float(uint c, uint x, uint light, float value)
{
    FloatArray(push.results + (uint64_t(c) * push.chunk.total + x) * uint64_t(4u * LIGHTS)).at[light] = value;
}

void put_answer(uint x, uint light, kiln_gpu_result r)
{
    for (uint c = 0u; c < 3u; c++) {
        put_float(KILN_GPU_REPLAY_INCIDENT + c, x, light, r.incident[c]);
        if (HAS_SMOOTH != 0u)
            put_float(KILN_GPU_REPLAY_IRRADIANCE + c, x, light, r.irradiance[c]);
    }
    put_float(KILN_GPU_REPLAY_ESCAPED, x, light, r.escaped);
    put_float(KILN_GPU_REPLAY_BLOCKED, x, light, r.blocked);
    put_float(KILN_GPU_REPLAY_ERROR, x, light, r.error);
}
