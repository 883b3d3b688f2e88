/* The direct pass, second: shadow rays. Thread (x, y) takes a slice of a quarter of every choice's samples at point x
 * (struct kiln_gpu_direct); of the choices with few samples those that are its own in turn, whole. Neighbouring threads take the same
 * sample of neighbouring points. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/direct.glsl"

#define KILN_TRACES
#include "shaders/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"

const uint DIMENSION_U = 0u, DIMENSION_V = 1u, DIMENSION_S = 2u, DIMENSION_T = 3u, DIMENSION_CHOICE = 4u;

/* One sequence of samples: of a choice at a point. */
struct Sequence {
    uint seed, shift; /* hashes of the tile and of the texel with the choice's identity */
};

Sequence sequence_of(kiln_gpu_point p, uint identity) { return Sequence(kiln_hash2(p.tile_key, identity), kiln_hash2(p.key, identity)); }

uint draw(Sequence sequence, uint k, uint dimension)
{
    const uint point = DirectWords(push.pass.sobol).at[dimension * push.pass.sobol_stride + k];
    return kiln_owen_scramble(point, kiln_hash2(sequence.seed, dimension)) ^ kiln_hash2(sequence.shift, dimension);
}

/* The same point of the light, seen from where the ray starts: `offset` along the normal. */
void aim_from(inout kiln_light_sample s, real3 normal, real offset)
{
    if (isinf(s.distance))
        return;
    const real3 to = s.direction * s.distance - normal * offset;
    const real distance = length(to);
    if (!(distance > 0))
        return;
    s.direction = to * (1 / distance);
    s.distance = distance;
}

struct Sums {
    real3 incident, irradiance; /* plain sums over samples */
    real luminance, square;     /* of irradiance: sum, and sum of squares */
    uint rays;
};

/* `aimed`: by the target, which is then the choice made ready for the point. */
void add_sample(inout Sums sums, kiln_gpu_point p, kiln_light_choice choice, bool aimed, kiln_light_target target, Sequence sequence, uint i, uint k)
{
    vec3 position, n;
    float offset;
    kiln_position(p, push.chunk.parts, float(real_unit(draw(sequence, k, DIMENSION_S))), float(real_unit(draw(sequence, k, DIMENSION_T))), position, n, offset);
    const real3 normal = real3(n), place = real3(position) - normal * real(offset);
    const real u = real_unit(draw(sequence, k, DIMENSION_U)), v = real_unit(draw(sequence, k, DIMENSION_V));
    kiln_light_sample s;
    bool brings;
    if (aimed)
        brings = kiln_light_target_sample(target, place, u, v, s);
    else
        brings = kiln_lights_sample(choice, i, place, normal, real_unit(draw(sequence, k, DIMENSION_CHOICE)), u, v, s);
    if (!brings)
        return;
    const real cosine = dot(normal, s.direction);
    if (!(cosine > 0))
        return;
    const bool smooth_point = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u;
    const real shading_cosine = smooth_point ? max(real(0), dot(real3(kiln_shading(p, n)), s.direction)) : cosine;
    aim_from(s, normal, real(offset));
    const float limit = isinf(s.distance) ? KILN_INFINITY : float((s.distance - s.backoff) * (1 - real(9.5367431640625e-7LF)));
    sums.rays++;
    if (kiln_occluded(position, vec3(s.direction), limit))
        return;
    sums.incident += s.value * cosine;
    sums.irradiance += s.value * shading_cosine;
    const real luminance = real_luminance(s.value * shading_cosine);
    sums.luminance += luminance;
    sums.square += luminance * luminance;
}

/* Variance of the mean of few samples, as if they were independent (shadow_variance). */
real few_variance(Sums sums, real samples)
{
    const real mean = sums.luminance / samples;
    return samples < 2 ? mean * mean : max(real(0), sums.square / samples - mean * mean) / (samples - 1);
}

/* Samples begin .. end-1 of a choice. */
Sums sample_choice(kiln_gpu_point p, kiln_light_choice choice, uint begin, uint end, inout uint stopped)
{
    const uint identity = kiln_hash2(choice.kind * 2u + 1u, choice.index);
    const uint strategies = kiln_lights_strategies(choice, real3(p.normal));
    Sums sums = Sums(real3(0), real3(0), 0, 0, 0u);
    kiln_light_target target;
    const bool aimed = kiln_light_target_of(choice, real3(p.centre), real(p.spread), target);
    uint i = begin;
    for (; i < end; i++)
        add_sample(sums, p, choice, aimed, target, sequence_of(p, identity + i % strategies), i, i / strategies);
    stopped |= i < end ? 1u : 0u;
    return sums;
}

void kiln_kernel(uint x, uint y)
{
    const uint index = kiln_point_of_thread(push.chunk, x), part = push.pass.row_first + y;
    if (index == KILN_GPU_NONE || part >= 4u * push.pass.slices)
        return;
    const uint slot = index - push.chunk.origin, count = direct_counts().at[slot];
    const uint quarter = part / push.pass.slices, slice = part % push.pass.slices, row = part * push.pass.split;
    const kiln_gpu_point p = PointArray(push.chunk.points).at[index];
    real3 incident = real3(0), irradiance = real3(0);
    real variance = 0;
    uint rays = 0u, stopped = 0u, i = 0u;
    for (; i < count; i++) {
        const kiln_gpu_choice packed = direct_choice(i).at[slot];
        const kiln_light_choice choice = kiln_light_choice(packed.what >> KILN_GPU_CHOICE_KIND_SHIFT,
                                                           packed.what & ((1u << KILN_GPU_CHOICE_KIND_SHIFT) - 1u), packed.samples);
        const bool quarters = choice.samples >= QUARTERS_FROM;
        if (!quarters && i % (4u * push.pass.slices) != part)
            continue;
        /* quarter q holds the samples k with k * 4 / samples == q; 2^20 samples and 1024 slices fit 32 bits, whose division is fast */
        const uint first = (quarter * choice.samples + 3u) / 4u, last = ((quarter + 1u) * choice.samples + 3u) / 4u;
        const uint begin = quarters ? first + (last - first) * slice / push.pass.slices : 0u;
        const uint end = quarters ? first + (last - first) * (slice + 1u) / push.pass.slices : choice.samples;
        const Sums sums = sample_choice(p, choice, begin, end, stopped);
        const real scale = 1 / real(choice.samples);
        incident += sums.incident * scale;
        irradiance += sums.irradiance * scale;
        rays += sums.rays;
        if (quarters)
            direct_luminance(i, row).at[slot] = float(sums.luminance);
        else
            variance += few_variance(sums, real(choice.samples));
    }
    stopped |= i < count ? 1u : 0u;
    direct_sums(row).at[slot] = kiln_gpu_direct_sums(real[3](incident.x, incident.y, incident.z), real[3](irradiance.x, irradiance.y, irradiance.z),
                                                     variance, rays, stopped);
}

#include "shaders/main.glsl"
