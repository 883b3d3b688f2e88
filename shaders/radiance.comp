/* Radiance probes: thread x computes item x, an element of a probe's map, with all its samples. Directions, random
 * numbers and estimator equal those of worker/backend/embree/radiance.c. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/streams.h"
#include "shaders/shared/warp.h"

KILN_PUSH(kiln_gpu_radiance_push);

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#ifdef KILN_GLOSS
#    define KILN_CHAIN_RADIOSITY
#    include "shaders/chain.glsl"
#endif

KILN_ARRAY(PositionArray, vec3, 4);
KILN_ARRAY(WordArray, uint, 4);
KILN_ARRAY(AnswerArray, vec4, 4);

float number(uint k, uint dimension, uint key)
{
    WordArray sobol = WordArray(push.sobol);
    return kiln_unit_float(kiln_owen_scramble(sobol.at[dimension * push.sobol_stride + k], kiln_hash2(key, dimension)));
}

bool good = true; /* the device has ended no loop early */

/* Radiosity that ray k finds; w: 1 if it hit the back of a single-sided surface that lets no light through. */
vec4 find_radiosity(vec3 position, vec3 direction, uint key, uint k)
{
    vec3 tint;
    const kiln_hit hit = kiln_trace_by_chance(position, direction, kiln_radiance_chance(key, k), tint);
    if (hit.triangle == KILN_GPU_NONE)
        return vec4(0.0);
#ifdef KILN_GLOSS
    if (chain_begins(hit)) {
        const Chain c = chain_follow(kiln_gather_chance(key), k, direction, hit);
        good = good && c.good;
        return vec4(HAS_ALPHA >= KILN_PASSAGE_TINT ? c.radiosity * tint : c.radiosity, 0.0);
    }
#endif
    const kiln_store_way to = kiln_store_enter(hit.triangle, hit.u, hit.v, hit.back);
    if (hit.back && (to.material & KILN_RECORD_DOUBLE_SIDED) == 0u)
        return vec4(0.0, 0.0, 0.0, (to.material & KILN_RECORD_CLEAR) == 0u ? 1.0 : 0.0);
    const vec3 rgb = kiln_store_radiosity(to);
    return vec4(HAS_ALPHA >= KILN_PASSAGE_TINT ? rgb * tint : rgb, 0.0);
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count)
        return;
    const uint64_t item = push.index + x;
    const uint64_t draws = push.period > 0u ? item % uint64_t(push.period) : item;
    const uint key = kiln_radiance_key(push.seed, push.stream, uint(draws), uint(draws >> 32));
    const uint element = uint(item % uint64_t(kiln_probe_elements(push.basis, push.side)));
    const vec3 position = PositionArray(push.positions).at[x];
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    uint k = 0u;
    for (; k < push.samples; k++) {
        const vec3 at = kiln_probe_point(push.basis, push.side, element, number(k, 0u, key), number(k, 1u, key));
        const float scale = inversesqrt(dot(at, at)), weight = scale * scale * scale;
        sum += weight * find_radiosity(position, at * scale, key, k);
        weights += weight;
    }
    sum /= weights;
    sum.rgb *= KILN_INVERSE_PI;
    if (k < push.samples || !good)
        sum.w = -1.0;
    AnswerArray(push.results).at[x] = sum;
}

#include "shaders/main.glsl"
