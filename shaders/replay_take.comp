/* Adds up the slices of light y of replay.comp, and takes the answers over on the device: what the integrator "cells"
 * does on the host (coordinator/integrate/cells/take.c), with the same bits, and its sums of power (ledger.c), in whole
 * units, so that no order counts. Each workgroup leaves its own sums; held_powers.comp adds these up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

uint light;
#define HEMISPHERE_REDUCE_PUSH kiln_gpu_replay_reduce_push
#define HEMISPHERE_SLICES (push.slices + uint64_t(light) * push.light_bytes)
#define GATHER_KERNEL
#include "shaders/gather_reduce.glsl"
#include "shaders/held.glsl"
#include "shaders/held_sums.glsl"

/* kiln_mean: what doubles say of a quotient of floats is near enough for its rounding. */
float mean_of(float sum) { return float(double(sum) / double(push.samples)); }

/* kiln_tally_add; `area` in m2 */
void tally(kiln_gpu_result r, vec3 incident, vec3 albedo, vec3 sent, double area, kiln_gpu_held_light about)
{
    const double per_unit = held_power_of_two(-int(about.unit));
    const double escaped = double(mean_of(r.escaped)), blocked = double(mean_of(r.blocked)),
                 error = double(mean_of(r.error)), lost = min(1.0LF, escaped + blocked);
    dvec3 power;
    for (uint c = 0u; c < 3u; c++) {
        precise const double arrives = area * double(incident[c]), goes = arrives * double(albedo[c]);
        precise const double leaves = area * double(sent[c]), escapes = leaves * escaped, stops = leaves * blocked;
        power[c] = leaves;
        set_power(INCIDENT + c, arrives, per_unit);
        set_power(REFLECTED + c, goes, per_unit);
        set_power(SENT + c, leaves, per_unit);
        set_power(ESCAPED + c, escapes, per_unit);
        set_power(BLOCKED + c, stops, per_unit);
    }
    const double luminance = 0.2126LF * power.r + 0.7152LF * power.g + 0.0722LF * power.b;
    set_power(VARIANCE, area * area * error * error + luminance * luminance * lost * (1.0LF - lost) / double(r.count),
              held_power_of_two(-int(about.unit_squared)));
}

/* Point `own` in the light. */
void take(kiln_gpu_held held, uint64_t own, bool valid, kiln_gpu_result r)
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
    const uvec2 sent = HeldPairs(held.from + pair).at[0];
    if (valid && area > 0.0LF)
        tally(r, incident, albedo, kiln_radiosity_unpack(sent), area, about);
    if (r.error < 0.0)
        HeldWords(held.powers + uint64_t(held.count * POWERS) * 16ul).at[0] = 1u;
}

void kiln_kernel(uint x, uint y)
{
    const kiln_gpu_held held = HeldRef(push.results).value;
    light = y;
    no_powers();
    if (x < push.chunk.total && y < push.lights) {
        kiln_gpu_result r;
        const bool valid = gather_result(x, r);
        take(held, push.first + uint64_t(x), valid, r);
    }
    add_up(held, light, x / THREADS, push.chunk.total);
}

#include "shaders/main.glsl"
