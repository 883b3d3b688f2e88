/* Takes the answers of replay_held.comp into the results on the device, as the integrator "cells" does on the host
 * (coordinator/integrate/cells/take.c), with the same bits. Also computes its sums of power (ledger.c), in integer
 * units, so that the order does not matter. A workgroup has 64 points under all LIGHTS lights, and stores its own sums;
 * held_powers.comp adds these up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/rows.h"

KILN_PUSH(kiln_gpu_replay_push);
layout(constant_id = 6) const uint LIGHTS = 1u;
const uint LANES = KILN_ROW_LANES(LIGHTS);

#include "shaders/held.glsl"
#include "shaders/held_sums.glsl"

KILN_ARRAY(PointArray, kiln_gpu_point, 8);
KILN_ARRAY(WordArray, uint, 4);
KILN_ARRAY(FloatArray, float, 4);

/* The answer of a valid point: sums over its samples. */
struct Answer {
    vec3 incident, irradiance;
    float escaped, blocked, error, present;
};

float float_of(uint c, uint x, uint light)
{
    return FloatArray(push.results + (uint64_t(c) * push.chunk.total + x) * uint64_t(4u * LIGHTS)).at[light];
}

vec3 floats_of(uint c, uint x, uint light)
{
    return vec3(float_of(c, x, light), float_of(c + 1u, x, light), float_of(c + 2u, x, light));
}

Answer answer_of(uint x, uint light)
{
    Answer r;
    r.incident = floats_of(KILN_GPU_REPLAY_INCIDENT, x, light);
    r.irradiance = HAS_SMOOTH != 0u ? floats_of(KILN_GPU_REPLAY_IRRADIANCE, x, light) : r.incident;
    r.escaped = float_of(KILN_GPU_REPLAY_ESCAPED, x, light);
    r.blocked = float_of(KILN_GPU_REPLAY_BLOCKED, x, light);
    r.error = float_of(KILN_GPU_REPLAY_ERROR, x, light);
    r.present = PointArray(push.chunk.points).at[push.chunk.origin + x].present;
    return r;
}

/* kiln_mean: the quotient of two floats in doubles is precise enough for the float's rounding. For a power of two, the
 * product with the inverse is exact. */
float mean_of(float sum)
{
    const float n = float(push.samples);
    return (push.samples & (push.samples - 1u)) == 0u ? sum * (1.0 / n) : float(double(sum) / double(push.samples));
}

/* kiln_tally_add; `area` in m2 */
void tally(Answer r, vec3 incident, vec3 albedo, vec3 sent, double area, kiln_gpu_held_light about)
{
    const double per_unit = held_power_of_two(-int(about.unit));
    const double escaped = double(mean_of(r.escaped)), blocked = double(mean_of(r.blocked)),
                 error = double(mean_of(r.error)), lost = min(1.0LF, escaped + blocked);
    dvec3 power;
    for (uint c = 0u; c < 3u; c++) {
        precise const double arrives = area * double(incident[c]), goes = arrives * double(albedo[c]);
        precise const double leaves = area * double(sent[c]), escapes = leaves * escaped, stops = leaves * blocked;
        power[c] = leaves;
        add_power(INCIDENT + c, arrives, per_unit);
        add_power(REFLECTED + c, goes, per_unit);
        add_power(SENT + c, leaves, per_unit);
        add_power(ESCAPED + c, escapes, per_unit);
        add_power(BLOCKED + c, stops, per_unit);
    }
    const double luminance = 0.2126LF * power.r + 0.7152LF * power.g + 0.0722LF * power.b;
    const double chance = luminance * luminance * lost * (1.0LF - lost) / double(push.samples);
    add_power(VARIANCE, area * area * error * error + chance, held_power_of_two(-int(about.unit_squared)));
}

/* Point `own` under the light. */
void take(kiln_gpu_held held, uint64_t own, uint light, bool valid, Answer r)
{
    const kiln_gpu_held_light about = HeldLights(held.lights).at[light];
    const kiln_gpu_held_point p = HeldPoints(held.of_point + own * 16ul).at[0];
    const uint64_t at = uint64_t(light) * held.points + own,
                   pair = (own * uint64_t(held.count) + uint64_t(light)) * 8ul;
    HeldFloats sum = HeldFloats(held.sums + at * 12ul);
    const vec3 albedo = held_albedo(about.albedo, own);
    precise vec3 incident = vec3(0.0), radiosity;
    for (uint c = 0u; c < 3u; c++) {
        incident[c] = valid ? mean_of(r.incident[c]) : 0.0;
        radiosity[c] = albedo[c] * incident[c];
        precise const float before = held.final != 0u ? 0.0 : sum.at[c];
        if (held.final != 0u)
            sum.at[c] = valid ? mean_of(r.irradiance[c]) : 0.0;
        else
            sum.at[c] = before + radiosity[c];
    }
    const float error = valid ? mean_of(r.error) : 0.0;
    HeldWords errors = HeldWords(held.errors + at * 4ul);
    if (held.final != 0u)
        errors.at[0] = held_error_add(errors.at[0] & 0xffffu, error) | held_error_add(errors.at[0] >> 16, error) << 16;
    else
        HeldPairs(held.to + pair).at[0] = held_next(held, p, radiosity, int(about.scale));
    const double area = packDouble2x32(uvec2(p.area[0], p.area[1])) * double(r.present);
    if (valid && area > 0.0LF)
        tally(r, incident, albedo, kiln_radiosity_unpack(HeldPairs(held.from + pair).at[0]), area, about);
    if (valid && r.error < 0.0)
        HeldWords(held.powers + uint64_t(held.count * POWERS) * 16ul).at[0] = 1u;
}

void kiln_kernel(uint thread, uint y)
{
    const kiln_gpu_held held = HeldRef(push.held).value;
    const uint lane = gl_LocalInvocationID.x, light = lane % LANES, group = thread / THREADS;
    no_powers();
    for (uint i = 0u; i < THREADS && light < LIGHTS; i += THREADS / LANES) {
        const uint x = group * THREADS + i + lane / LANES;
        if (x >= push.chunk.total)
            break;
        const bool valid = (WordArray(push.chunk.states).at[push.chunk.origin + x] & KILN_GPU_STATE_MASK) !=
                           KILN_GPU_STATE_INVALID;
        take(held, push.first + uint64_t(x), light, valid, answer_of(x, light));
    }
    add_up(held, 0u, group);
}

#include "shaders/main.glsl"
