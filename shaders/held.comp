/* Light that stays on the device: what a light begins with, as the host has it, or what the final gather reads. Thread
 * (x, y): point x; light y where the step is of all lights. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_held_push);

/* bytes are radiosity in 8 bytes, or in 4, which goes to `to`; errors in 2; or sums are packed for `to` */
const uint PACKED = 0u, COMPACT = 1u, ERRORS = 2u, SUMS = 3u;
layout(constant_id = 6) const uint STEP = PACKED;

#include "shaders/held.glsl"

void kiln_kernel(uint x, uint y)
{
    const kiln_gpu_held held = HeldRef(push.held).value;
    const uint light = STEP == SUMS ? y : push.light;
    if (uint64_t(x) >= held.points || light >= held.count)
        return;
    const uint64_t of_light = uint64_t(light) * held.points;
    if (STEP == ERRORS) {
        const uint two = HeldWords(push.bytes).at[x >> 1];
        HeldWords(held.errors + of_light * 4ul).at[x] = (x & 1u) != 0u ? two >> 16 : two & 0xffffu;
        return;
    }
    uvec2 pair;
    if (STEP == PACKED) {
        pair = HeldPairs(push.bytes).at[x];
    } else if (STEP == COMPACT) {
        pair = held_expand(HeldWords(push.bytes).at[x], int(HeldLights(held.lights).at[light].scale));
    } else {
        const kiln_gpu_held_point p = HeldPoints(held.of_point).at[x];
        HeldFloats sum = HeldFloats(held.sums + (of_light + uint64_t(x)) * 12ul);
        pair = held_pack(vec3(sum.at[0], sum.at[1], sum.at[2]), held_hash(p, p.bit, held.stream));
    }
    HeldPairs(held.to + (uint64_t(x) * uint64_t(held.count) + uint64_t(light)) * 8ul).at[0] = pair;
}

#include "shaders/main.glsl"
