/* The bounce pass: thread (x, y) takes slice y of the samples of point x, a few cosine-distributed rays, and adds up
 * the radiosity that they find. The samples of a point fall into four quarters, each of `slices` slices: neighbouring
 * threads take the same sample of neighbouring points, whose directions share a stratum (shaders/shared/random.h).
 * gather_reduce.comp adds up the slices. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_gather_push);

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"

layout(constant_id = 5) const uint LOOKUP = 1u; /* 0: trace only, for benches */

KILN_ARRAY(FloatArray, float, 4);

/* Cosine-distributed about unit n. `cosine`: with n. */
vec3 cosine_direction(vec3 n, float u, float v, out float cosine)
{
    const float radius = sqrt(u), turn = v - 0.5, a = abs(turn);
    const float sine = kiln_sine_turn(min(a, 0.5 - a));
    vec3 t, b;
    kiln_basis(n, t, b);
    cosine = sqrt(1.0 - u);
    return radius * kiln_sine_turn(0.25 - a) * t + radius * (turn < 0.0 ? -sine : sine) * b + cosine * n;
}

const uint SLICE_FLOATS = HAS_ALPHA == KILN_PASSAGE_TINT ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS;

struct Sums {
    vec3 incident, irradiance, glass;
    float escaped, blocked, luminance;
};

void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed)
{
    const vec3 soft = kiln_shading(p, normal);
    vec3 axis = normal;
    float tilt = 1.0;
    if (HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u) {
        const vec3 both = normal + soft; /* 0 where the triangle is too small to have a normal */
        axis = both == vec3(0.0) ? both : normalize(both);
        tilt = dot(normal, axis);
    }
    float cosine;
    const vec3 direction = cosine_direction(axis, u, v, cosine);
    vec3 tint;
    const kiln_hit hit = kiln_trace_by_chance(position, direction, seed, tint);
    if (LOOKUP == 0u) {
        sums.escaped += hit.triangle == KILN_GPU_NONE ? 1.0 : hit.u;
        return;
    }
    float facet = 1.0, weight = 1.0;
    if (HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u) {
        const float above = dot(normal, direction), shading = dot(soft, direction);
        facet = kiln_facet_weight(above, tilt, cosine);
        weight = kiln_shading_weight(shading, cosine);
    }
    if (hit.triangle == KILN_GPU_NONE) {
        sums.escaped += facet;
        return;
    }
    const kiln_landing to = kiln_land(hit.triangle, hit.u, hit.v, hit.back);
    if (hit.back && (to.material & KILN_RECORD_DOUBLE_SIDED) == 0u) {
        sums.blocked += facet;
        return;
    }
    vec3 rgb = facet > 0.0 ? kiln_radiosity_at(to) : vec3(0.0);
    if (HAS_ALPHA == KILN_PASSAGE_TINT) {
        rgb *= tint;
        sums.glass += facet * (1.0 - tint);
    }
    sums.incident += facet * rgb;
    if (HAS_SMOOTH != 0u)
        sums.irradiance += weight * rgb;
    sums.luminance += weight * float_luminance(rgb);
}

void store(Sums sums, uint x, uint y)
{
    FloatArray slices = FloatArray(push.slices + uint64_t(y * push.row_step * SLICE_FLOATS) * push.chunk.total * 4ul);
    const uint step = push.chunk.total;
    for (uint c = 0u; c < 3u; c++) {
        slices.at[c * step + x] = sums.incident[c];
        slices.at[(3u + c) * step + x] = HAS_SMOOTH != 0u ? sums.irradiance[c] : sums.incident[c];
    }
    slices.at[6u * step + x] = sums.escaped;
    slices.at[7u * step + x] = sums.blocked;
    slices.at[8u * step + x] = sums.luminance;
    for (uint c = 0u; c < 3u && HAS_ALPHA == KILN_PASSAGE_TINT; c++)
        slices.at[(9u + c) * step + x] = sums.glass[c];
}

void kiln_kernel(uint x, uint row)
{
    const uint y = push.row_first + row;
    const uint index = kiln_point_of_thread(push.chunk, x);
    if (index == KILN_GPU_NONE || y >= 4u * push.per_quarter)
        return;
    const kiln_gpu_point p = PointArray(push.chunk.points).at[index];
    /* quarter q holds the samples k with k * 4 / samples == q */
    const uint q = y / push.per_quarter, n = push.samples;
    const uint begin = kiln_quarter_first(q, n), end = kiln_quarter_first(q + 1u, n);
    const uint from = begin + (y % push.per_quarter) * push.slice, to = min(end, from + push.slice);
    uint seed[4];
    for (uint d = 0u; d < 4u; d++)
        seed[d] = kiln_gather_seed(p.tile_key, push.stream, d);
    const uint key = kiln_hash2(p.key, push.stream), shared_digits = kiln_shared_digits(n);
    const uint shift_u = kiln_direction_shift(key, KILN_DIMENSION_U, shared_digits);
    const uint shift_v = kiln_direction_shift(key, KILN_DIMENSION_V, shared_digits);
    const uint chance = kiln_gather_chance(key);
    const uint shift_s = kiln_gather_shift(key, KILN_DIMENSION_S), shift_t = kiln_gather_shift(key, KILN_DIMENSION_T);
    const bool shares = DRAW_AGAIN != 0u || (p.flags & (KILN_GPU_POINT_PARTIAL | KILN_GPU_POINT_MASKED)) != 0u;
    WordArray sobol = WordArray(push.sobol);
    Sums sums = Sums(vec3(0.0), vec3(0.0), vec3(0.0), 0.0, 0.0, 0.0);
    vec3 position, normal;
    uint drawn = KILN_GPU_NONE;
    uint k = from;
    for (; k < to; k++) {
        const uint place = shares ? k / push.reuse : k;
        if (place != drawn) {
            const float s =
                kiln_unit_float(kiln_owen_scramble(sobol.at[2u * push.sobol_stride + place], seed[2]) ^ shift_s);
            const float t =
                kiln_unit_float(kiln_owen_scramble(sobol.at[3u * push.sobol_stride + place], seed[3]) ^ shift_t);
            float offset;
            kiln_position(p, push.chunk.parts, s, t, position, normal, offset);
            drawn = place;
        }
        const float u = kiln_unit_float(kiln_owen_scramble(sobol.at[k], seed[0]) ^ shift_u);
        const float v = kiln_unit_float(kiln_owen_scramble(sobol.at[push.sobol_stride + k], seed[1]) ^ shift_v);
        add_ray(sums, p, position, normal, u, v,
                HAS_ALPHA >= KILN_PASSAGE_BLEND ? kiln_gather_ray_seed(chance, k) : 0u);
    }
    if (k < to) /* the device ended the loop early */
        sums.escaped = -1.0e9;
    store(sums, index - push.chunk.origin, y);
}

#include "shaders/main.glsl"
