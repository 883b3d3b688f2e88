/* Direct light under several lights at once, for a bake whose light stays on the device (kiln relight --states). Thread
 * (x, y): point push.first + x under light y. It sums up the stored direct light of the light's parts, scaled by
 * colour. From the sum it computes the results of a step of the integrator "cells": irradiance, errors, the radiosity
 * to gather next, and sums of power. The results have the same bits as the host's code,
 * coordinator/bake/states/state_lights.c and coordinator/integrate/cells/take.c. Lights whose direct light the host has
 * computed are skipped. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_held_push);

#include "shaders/held.glsl"
const uint LANES = 1u;
#include "shaders/held_sums.glsl"

/* The answer of a point: means. */
struct Direct {
    vec3 irradiance, incident;
    float error, present;
};

double luminance_of(vec3 rgb)
{
    precise const double all = 0.2126LF * double(rgb.r) + 0.7152LF * double(rgb.g) + 0.0722LF * double(rgb.b);
    return all;
}

/* Each operation is rounded apart. */
vec3 product(vec3 a, vec3 b)
{
    precise const vec3 all = a * b;
    return all;
}
vec3 sum_of(vec3 a, vec3 b)
{
    precise const vec3 all = a + b;
    return all;
}
double plus_square(double all, double error)
{
    precise const double more = error * error, both = all + more;
    return both;
}
double scaled_error(vec3 light, vec3 scaled, vec3 factor, float error)
{
    const double before = luminance_of(light);
    precise const double scale = before > 0.0LF ? luminance_of(scaled) / before : luminance_of(factor);
    precise const double all = scale * double(error);
    return all;
}

/* add_part and kiln_point_mean of the host: with a power of two of samples, divisions are exact. */
Direct mix_parts(kiln_gpu_held held, kiln_gpu_held_light about, uint own)
{
    vec3 irradiance = vec3(0.0), incident = vec3(0.0);
    double square = 0.0LF;
    const float samples = float(about.samples), each = 1.0 / samples;
    float present = 1.0;
    bool valid = true;
    for (uint k = 0u; k < about.part_count; k++) {
        const kiln_gpu_held_term part = HeldTerms(held.mixes + uint64_t(about.part_first + k) * 24ul).at[0];
        const kiln_gpu_direct_answer a = DirectAnswers(part.answers + uint64_t(own) * 36ul).at[0];
        const vec3 factor = vec3(part.factor[0], part.factor[1], part.factor[2]),
                   light = vec3(a.irradiance[0], a.irradiance[1], a.irradiance[2]),
                   flat_light = vec3(a.incident[0], a.incident[1], a.incident[2]);
        const vec3 scaled = product(factor, light);
        irradiance = sum_of(irradiance, samples * scaled);
        incident = sum_of(incident, product(samples * factor, flat_light));
        square = plus_square(square, scaled_error(light, scaled, factor, a.error));
        present = a.present;
        valid = a.count > 0u;
    }
    if (!valid)
        return Direct(vec3(0.0), vec3(0.0), 0.0, present);
    return Direct(each * irradiance, each * incident, each * float(double(samples) * sqrt(square)), present);
}

/* kiln_tally_add of the host, for light that has arrived; `area` in m2 */
void tally(Direct r, vec3 albedo, double area, kiln_gpu_held_light about)
{
    const double per_unit = held_power_of_two(-int(about.unit)), error = double(r.error);
    for (uint c = 0u; c < 3u; c++) {
        precise const double arrives = area * double(r.incident[c]), goes = arrives * double(albedo[c]);
        add_power(INCIDENT + c, arrives, per_unit);
        add_power(REFLECTED + c, goes, per_unit);
    }
    precise const double variance = area * area * error * error;
    add_power(VARIANCE, variance, held_power_of_two(-int(about.unit_squared)));
}

void put(uint64_t floats, vec3 rgb)
{
    HeldFloats to = HeldFloats(floats);
    for (uint c = 0u; c < 3u; c++)
        to.at[c] = rgb[c];
}

void take(kiln_gpu_held held, uint light, kiln_gpu_held_light about, uint own)
{
    const kiln_gpu_held_point p = HeldPoints(held.of_point).at[own];
    const Direct r = mix_parts(held, about, own);
    const vec3 albedo = held_albedo(about.albedo, uint64_t(own));
    const vec3 radiosity = product(albedo, r.incident);
    const uint64_t at = uint64_t(light) * held.points + uint64_t(own);
    const uint error = held_error_pack(r.error);
    put(held.direct + at * 12ul, r.irradiance);
    put(held.sums + at * 12ul, radiosity);
    HeldWords(held.errors + at * 4ul).at[0] = error;
    HeldWords(held.direct_errors + at * 4ul).at[0] = error;
    HeldPairs(held.to + (uint64_t(own) * uint64_t(held.count) + uint64_t(light)) * 8ul).at[0] =
        held_next(held, p, radiosity, int(about.scale));
    const double area = packDouble2x32(uvec2(p.area[0], p.area[1])) * double(r.present);
    if (area > 0.0LF)
        tally(r, albedo, area, about);
}

void kiln_kernel(uint x, uint y)
{
    const kiln_gpu_held held = HeldRef(push.held).value;
    no_powers();
    if (x < push.count && y < held.count) {
        const kiln_gpu_held_light about = HeldLights(held.lights).at[y];
        if (about.part_count != KILN_GPU_NONE)
            take(held, y, about, push.first + x);
    }
    add_up(held, y, x / THREADS);
}

#include "shaders/main.glsl"
