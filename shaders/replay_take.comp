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

const uint THREADS = 64u, POWERS = KILN_GPU_HELD_POWERS, SHARES = THREADS / POWERS;
const uint INCIDENT = 0u, REFLECTED = 3u, SENT = 6u, ESCAPED = 9u, BLOCKED = 12u, VARIANCE = 15u;

shared int64_t high[THREADS * POWERS], low[THREADS * POWERS];

/* kiln_exact_add: the whole number of units next to 0, by the double's own bits, since conversions to 64 bits are not
 * the same on all devices. */
void set_power(uint k, double value, double per_unit)
{
    precise const double steps = value * per_unit;
    const uvec2 words = unpackDouble2x32(steps);
    const int exponent = int(words.y >> 20 & 0x7ffu) - 1075;
    uint64_t digits = packUint2x32(uvec2(words.x, words.y & 0xfffffu | 0x100000u));
    if (exponent < 0)
        digits = exponent > -53 ? digits >> -exponent : 0ul;
    const int up = max(exponent, 0), down = max(40 - up, 0);
    const uint64_t above = up > 40 ? digits << (up - 40) : digits >> down;
    const uint64_t below = (digits & ((1ul << down) - 1ul)) << min(up, 40);
    const uint at = gl_LocalInvocationID.x * POWERS + k;
    const bool negative = words.y >> 31 != 0u;
    high[at] = negative ? -int64_t(above) : int64_t(above);
    low[at] = negative ? -int64_t(below) : int64_t(below);
}

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
    precise vec3 incident = vec3(0.0), albedo, radiosity;
    for (uint c = 0u; c < 3u; c++) {
        const uint64_t half_ = 3ul * own + uint64_t(c);
        const uint two = HeldWords(about.albedo + (half_ >> 1) * 4ul).at[0];
        albedo[c] = float((half_ & 1ul) != 0ul ? two >> 16 : two & 0xffffu) * KILN_RATIO32(1, 65535);
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

/* Of all threads: the sums of power that they have set, to the workgroup's place. */
void add_up(kiln_gpu_held held, uint group)
{
    const uint lane = gl_LocalInvocationID.x, power = lane / SHARES, share = lane % SHARES;
    int64_t sum[2] = int64_t[2](0, 0);
    barrier();
    for (uint t = share * (THREADS / SHARES); t < (share + 1u) * (THREADS / SHARES); t++) {
        sum[0] += high[t * POWERS + power];
        sum[1] += low[t * POWERS + power];
    }
    barrier();
    high[lane] = sum[0];
    low[lane] = sum[1];
    barrier();
    if (share != 0u || group * THREADS >= push.chunk.total || light >= held.count)
        return;
    for (uint i = 1u; i < SHARES; i++) {
        sum[0] += high[lane + i];
        sum[1] += low[lane + i];
    }
    const uint64_t at = uint64_t(group * held.count + light) * uint64_t(POWERS) + uint64_t(power);
    HeldPowers(held.parts + at * 16ul).at[0] = kiln_gpu_held_power(uint64_t(sum[0]), uint64_t(sum[1]));
}

void kiln_kernel(uint x, uint y)
{
    const kiln_gpu_held held = HeldRef(push.results).value;
    light = y;
    for (uint k = 0u; k < POWERS; k++)
        high[gl_LocalInvocationID.x * POWERS + k] = low[gl_LocalInvocationID.x * POWERS + k] = int64_t(0);
    if (x < push.chunk.total && y < push.lights) {
        kiln_gpu_result r;
        const bool valid = gather_result(x, r);
        take(held, push.first + uint64_t(x), valid, r);
    }
    add_up(held, x / THREADS);
}

#include "shaders/main.glsl"
