/* The directional pass. Each thread computes a slice of a point's samples (hemisphere.glsl): rays evenly distributed
 * over the hemisphere, for light of surfaces and a constant sky, and an equal share of the shadow rays to the other
 * lights (light_samples.glsl). directional_reduce.comp sums up the slices. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/harmonics.h"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_hemisphere_push);

const uint HARMONICS = 4u; /* bands 0 and 1 */

struct Sums {
    vec3 radiance[HARMONICS];
    float rays; /* shadow rays */
};

#define NO_SUMS Sums(vec3[HARMONICS](vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0)), 0.0)
#include "shaders/hemisphere.glsl"
#include "shaders/lights.glsl"
#ifdef KILN_GLOSS
#    define KILN_WALK_LIGHTS
#    define KILN_CHAIN_RADIOSITY
#    include "shaders/chain.glsl"
#endif

/* Position from which light samples are drawn: that of sample k is where the ray of sample k starts. */
struct Place {
    kiln_gpu_point point;
    uint number;           /* of the place; KILN_GPU_NONE: none yet */
    vec3 position, normal; /* with its offset off the surface; geometric */
    float offset;
};

#include "shaders/light_samples.glsl"

/* Adds radiance x solid angle `value` that arrives from direction d. */
void add_direction(inout Sums sums, vec3 d, vec3 value)
{
#define KILN_ADD(index, y) sums.radiance[index] += y * value;
    KILN_HARMONICS_LINEAR(KILN_ADD, d)
#undef KILN_ADD
}

void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed)
{
    const vec3 direction = hemisphere_direction(normal, sqrt(u * (2.0 - u)), 1.0 - u, v);
    vec3 tint, radiance = vec3(0.0);
    const kiln_hit hit = kiln_trace_by_chance(position, direction, seed, tint);
    if (hit.triangle == KILN_GPU_NONE) {
        if (light_kind(KILN_GPU_KIND_SKY))
            radiance = kiln_environment_radiance(real3(direction));
#ifdef KILN_GLOSS
    } else if (chain_begins(hit)) {
        const Chain c = chain_follow(ray_chance, ray_number, direction, hit);
        chains_good = chains_good && c.good;
        radiance = c.radiosity * KILN_INVERSE_PI + c.light;
#endif
    } else {
        const kiln_store_way to = kiln_store_enter(hit.triangle, hit.u, hit.v, hit.back);
        if (!hit.back || (to.material & KILN_RECORD_DOUBLE_SIDED) != 0u)
            radiance = kiln_store_radiosity(to) * KILN_INVERSE_PI;
    }
    if (HAS_ALPHA >= KILN_PASSAGE_TINT)
        radiance *= tint;
    add_direction(sums, direction, radiance * (6.283185307179586 / float(push.hemisphere.samples)));
}

float place_number(uint k, uint dimension, kiln_gpu_point p)
{
    const uint stream = push.hemisphere.stream,
               point = WordArray(push.hemisphere.sobol).at[dimension * push.hemisphere.sobol_stride + k];
    return kiln_unit_float(kiln_owen_scramble(point, kiln_gather_seed(p.tile_key, stream, dimension)) ^
                           kiln_gather_shift(kiln_hash2(p.key, stream), dimension));
}

void go_to(inout Place place, uint k)
{
    const uint number = hemisphere_shares(place.point) ? k / push.hemisphere.reuse : k;
    if (number == place.number)
        return;
    kiln_position(place.point, push.chunk.parts, place_number(number, KILN_DIMENSION_S, place.point),
                  place_number(number, KILN_DIMENSION_T, place.point), place.position, place.normal, place.offset);
    place.number = number;
}

void add_light(inout Sums sums, inout Place place, kiln_light_choice choice, uint identity, uint k)
{
    go_to(place, k);
    const real3 n = real3(place.normal), off = n * real(place.offset);
    kiln_light_sample s;
    if (!draw_light(Sobol(push.hemisphere.sobol, push.hemisphere.sobol_stride), choice, identity, k,
                    real3(place.position) - off, s) ||
        !(dot(n, s.direction) > 0))
        return;
    sums.rays += 1.0;
    float limit;
    const vec3 towards = kiln_shadow_ray(s, off, limit), through = kiln_through(place.position, towards, limit);
    if (through != vec3(0.0))
        add_direction(sums, vec3(s.direction), vec3(s.value / real(choice.samples)) * through);
}

/* Adds the slice's share of the light samples: all slices have equally many, but for one. */
bool add_lights(inout Sums sums, kiln_gpu_point p, uint row)
{
    const real3 n = (p.flags & KILN_GPU_POINT_ONE_NORMAL) != 0u ? real3(p.normal) : real3(0);
    const uint samples = push.hemisphere.samples, key = kiln_hash2(p.key, push.hemisphere.stream),
               slices = 4u * push.hemisphere.per_quarter;
    const uint candidates = kiln_lights_choose(real3(p.centre), real(p.spread), n, kiln_cut_limit(samples),
                                               light_kind(KILN_GPU_KIND_IMAGE));
    const uint64_t count = light_sample_count(candidates, n, samples);
    Place place;
    place.point = p;
    place.number = KILN_GPU_NONE;
    return light_samples(sums, place, candidates, n, samples, key, uint(count * row / slices),
                         uint(count * (row + 1u) / slices));
}

void after_rays(inout Sums sums, kiln_gpu_point p, uint row, bool good)
{
    if (LIGHT_KINDS != 0u && LIGHT_KINDS != KILN_GPU_KIND_SKY)
        good = add_lights(sums, p, row) && good;
#ifdef KILN_GLOSS
    good = good && chains_good;
#endif
    if (!good)
        sums.radiance[0].r = -1.0e30;
}

void store(Sums sums, uint x, uint row)
{
    FloatArray floats = hemisphere_floats(row, KILN_GPU_DIRECTIONAL_FLOATS);
    for (uint i = 0u; i < HARMONICS; i++)
        for (uint c = 0u; c < 3u; c++)
            floats.at[(3u * i + c) * push.chunk.total + x] = sums.radiance[i][c];
    floats.at[3u * HARMONICS * push.chunk.total + x] = sums.rays;
}

#include "shaders/main.glsl"
