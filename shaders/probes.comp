/* The probe pass on a device (worker/pass/probes.h): light that arrives at the probes of an irradiance volume. Thread
 * (x, y) computes slice `slice_first` + y of the samples of probe x. A slice has a range of rays over the whole sphere,
 * which hit surfaces and a constant sky, and a range of light samples of the same length, with shadow rays to the other
 * lights; one kernel traces the rays, and the next one takes the light samples and adds to the sums. Light samples are
 * numbered through all choices of lights (light_samples.glsl); the last slice takes all that are left. Directions,
 * random numbers and estimators equal those of worker/backend/embree/probes.c. probes_reduce.comp sums up the slices.
 * With GROUPED the result of each ray is kept for probes_groups.comp, which separates groups of lights. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/harmonics.h"
#include "shaders/shared/layout_probe.h"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_probes_push);

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/lights.glsl"
#include "shaders/light_groups.glsl"
#ifdef KILN_GLOSS
#    define KILN_WALK_LIGHTS
#    define KILN_CHAIN_RADIOSITY
#    define KILN_WALK_LEAVES push.leaves
#    include "shaders/chain.glsl"
#endif

layout(constant_id = 6) const uint STAGES = KILN_GPU_PROBE_RAYS | KILN_GPU_PROBE_LIGHTS; /* KILN_GPU_PROBE_... */
const bool GROUPED = (STAGES & KILN_GPU_PROBE_GROUPED) != 0u, RAYS = (STAGES & KILN_GPU_PROBE_RAYS) != 0u,
           LIGHTS = (STAGES & KILN_GPU_PROBE_LIGHTS) != 0u;

KILN_ARRAY(PositionArray, vec3, 4);

struct Sums {
    vec3 radiance[KILN_HARMONICS], axes[6];
    float distance, back, rays;
    bool stopped; /* the device ended a loop early */
};
struct Place {
    vec3 position;
    uint probe, sample_number; /* of the next light sample */
};

#include "shaders/light_samples.glsl"
#include "shaders/probe_direction.glsl"
#include "shaders/probe_found.glsl"
#include "shaders/probe_slices.glsl"

Sobol sobol() { return Sobol(push.sobol, push.sobol_stride); }

/* Returns the hit of a ray over the sphere as a word (probe_found.glsl). */
uint found_word(kiln_hit hit, real3 direction)
{
    const kiln_light_sample sky = kiln_light_sample(direction, real(KILN_INFINITY), real3(0), 0, true, KILN_GPU_NONE);
    if (hit.triangle == KILN_GPU_NONE)
        return light_kind(KILN_GPU_KIND_SKY) ? FOUND_SKY | light_group(KILN_CHOICE_ENVIRONMENT, 0u, sky, real3(0))
                                             : FOUND_NOTHING;
    const kiln_store_way to = kiln_store_enter(hit.triangle, hit.u, hit.v, hit.back);
    uint64_t point;
    if (hit.back && (to.material & KILN_RECORD_DOUBLE_SIDED) == 0u)
        return FOUND_NOTHING;
    return kiln_store_point(to, point) ? uint(point) : FOUND_NOTHING;
}

void sphere_sample(inout Sums sums, uint x, vec3 p, uint key, uint k)
{
    const real3 direction = kiln_sphere_direction(scrambled(sobol(), k, KILN_DIMENSION_U, kiln_hash2(key, 0u)),
                                                  scrambled(sobol(), k, KILN_DIMENSION_V, kiln_hash2(key, 1u)));
    const vec3 d = vec3(direction);
    vec3 tint;
    const kiln_hit hit = kiln_trace_by_chance(p, d, kiln_hash2(key + 1u, k), tint);
    if (GROUPED)
        found_sphere(k, x).at[0] = Found(d, found_word(hit, direction));
    vec3 radiance = vec3(0.0);
    if (hit.triangle == KILN_GPU_NONE) {
        sums.distance += push.far;
        if (light_kind(KILN_GPU_KIND_SKY))
            radiance = kiln_environment_radiance(direction);
#ifdef KILN_GLOSS
    } else if (chain_begins(hit)) {
        sums.distance += min(hit.distance, push.far);
        const Chain c = chain_follow(kiln_gather_chance(key), k, d, hit);
        sums.stopped = sums.stopped || !c.good;
        radiance = c.radiosity * KILN_INVERSE_PI + c.light;
#endif
    } else {
        sums.distance += min(hit.distance, push.far);
        const kiln_store_way to = kiln_store_enter(hit.triangle, hit.u, hit.v, hit.back);
        if (hit.back && (to.material & (KILN_RECORD_DOUBLE_SIDED | KILN_RECORD_CLEAR)) == 0u)
            sums.back += 1.0;
        if (!hit.back || (to.material & KILN_RECORD_DOUBLE_SIDED) != 0u)
            radiance = kiln_store_radiosity(to) * KILN_INVERSE_PI;
    }
    if (HAS_ALPHA >= KILN_PASSAGE_TINT)
        radiance *= tint;
    add_direction(sums, d, radiance * (12.566370614359172 / float(push.samples)));
}

void add_light(inout Sums sums, inout Place place, kiln_light_choice choice, uint identity, uint k)
{
    kiln_light_sample s;
    const uint number = place.sample_number++;
    if (GROUPED)
        found_light(number, place.probe).at[0] = FoundLight(vec3(0.0), vec3(0.0), FOUND_NOTHING);
    if (!draw_light(sobol(), choice, identity, k, real3(place.position), s))
        return;
    sums.rays += 1.0;
    const float limit = isinf(s.distance) ? KILN_INFINITY : float((s.distance - s.backoff) * KILN_SHADOW_LENGTH);
    const vec3 d = vec3(s.direction);
    const vec3 through = kiln_through(place.position, d, limit);
    const vec3 value = vec3(s.value / real(choice.samples)) * through;
    if (through != vec3(0.0))
        add_direction(sums, d, value);
    if (GROUPED)
        found_light(number, place.probe).at[0] =
            FoundLight(d, value, light_group(choice.kind, choice.index, s, real3(place.position)));
}

void sphere_samples(inout Sums sums, uint x, vec3 position, uint key, uint from)
{
    const uint to = min(push.samples, from + KILN_GPU_PROBE_SAMPLES);
    uint k = from;
    for (; k < to; k++)
        sphere_sample(sums, x, position, key, k);
    sums.stopped = sums.stopped || k < to;
}

/* The slice's light samples. Where groups are told apart, the last slice counts all. */
void all_lights(inout Sums sums, uint x, vec3 position, uint key, uint from, bool last)
{
    uint lights = 0u;
    if (LIGHT_KINDS != 0u && LIGHT_KINDS != KILN_GPU_KIND_SKY) {
        Place place = Place(position, x, from);
        const uint candidates =
            kiln_lights_choose(real3(position), 0, real3(0), KILN_CUT_MAX, light_kind(KILN_GPU_KIND_IMAGE));
        const uint to = last ? 0xffffffffu : min(push.samples, from + KILN_GPU_PROBE_SAMPLES);
        if (!light_samples(sums, place, candidates, real3(0), push.samples, key, from, to))
            sums.stopped = true;
        if (GROUPED)
            lights = light_sample_count(candidates, real3(0), push.samples);
    }
    if (GROUPED && last)
        found_lights(x).at[0] = lights;
}

void kiln_kernel(uint x, uint y)
{
    const uint slice = push.slice_first + y;
    if (x >= push.count || slice >= push.slice_count)
        return;
    const vec3 position = PositionArray(push.positions).at[x];
    const uint64_t index = push.index + x;
    const uint key = kiln_hash2(kiln_hash2(push.seed, uint(index)), uint(index >> 32));
    const uint from = slice * KILN_GPU_PROBE_SAMPLES;
    Sums sums;
    for (uint i = 0u; i < KILN_HARMONICS; i++)
        sums.radiance[i] = vec3(0.0);
    for (uint i = 0u; i < 6u; i++)
        sums.axes[i] = vec3(0.0);
    sums.distance = 0.0;
    sums.back = 0.0;
    sums.rays = 0.0;
    sums.stopped = false;
    if (!RAYS)
        load(sums, x, slice);
    else
        sphere_samples(sums, x, position, key, from);
    if (LIGHTS)
        all_lights(sums, x, position, key, from, slice + 1u == push.slice_count);
    if (sums.stopped)
        sums.distance = -1.0e30;
    store(sums, x, slice);
}

#include "shaders/main.glsl"
