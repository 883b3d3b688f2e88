/* Conversions of light that stays on the device: of the initial state of a light, from the host; of radiosity for the
 * final gather; of errors that the host fetches. Thread (x, y): point x, or points 2x and 2x + 1; light y if the step
 * is for all lights. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_held_push);

/* Conversions. PACKED, COMPACT: bytes with radiosity in 8 or 4 bytes per point are written to `to`. ERRORS: reads
 * errors of 2 bytes. SUMS: packs sums for `to`. FETCHED: writes errors of 2 bytes for the host, of all light, then of
 * direct and of indirect light, each with an even number of points. */
const uint PACKED = 0u, COMPACT = 1u, ERRORS = 2u, SUMS = 3u, FETCHED = 4u;
layout(constant_id = 6) const uint STEP = PACKED;

#include "shaders/held.glsl"

/* Writes the errors of two points under the light. */
void fetch(kiln_gpu_held held, uint64_t of_light, uint x)
{
    const uint points = uint(held.points), pairs = (points + 1u) / 2u, second = min(2u * x + 1u, points - 1u);
    HeldWords errors = HeldWords(held.errors + of_light * 4ul), direct = HeldWords(held.direct_errors + of_light * 4ul);
    HeldWords bytes = HeldWords(push.bytes);
    const uint one = errors.at[2u * x], two = errors.at[second];
    bytes.at[x] = (one & 0xffffu) | two << 16;
    bytes.at[2u * pairs + x] = one >> 16 | (two & 0xffff0000u);
    if (HeldLights(held.lights).at[push.light].part_count != KILN_GPU_NONE)
        bytes.at[pairs + x] = (direct.at[2u * x] & 0xffffu) | direct.at[second] << 16;
}

void kiln_kernel(uint x, uint y)
{
    const kiln_gpu_held held = HeldRef(push.held).value;
    const uint light = STEP == SUMS ? y : push.light;
    if (uint64_t(x) >= held.points || light >= held.count)
        return;
    const uint64_t of_light = uint64_t(light) * held.points;
    if (STEP == FETCHED) {
        if (2ul * uint64_t(x) < held.points)
            fetch(held, of_light, x);
        return;
    }
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
