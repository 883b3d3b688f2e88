/* Chains of the rays of the gather pass that have met gloss, apart from these (gather_chains.glsl): thread x follows
 * those that the list has at x, x + `threads` and so on. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_CHAIN_RADIOSITY
#define KILN_APART
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_chains_push);
#define APART_POINTS push.points
#define APART_SAMPLES push.samples
#define APART_ROWS push.rows
#define APART_ROOM push.room

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/gather_sums.glsl"
#include "shaders/chain.glsl"
#include "shaders/gather_chains.glsl"

void follow(uint number)
{
    const uint64_t place = apart_numbered(number);
    const kiln_gpu_apart_ray ray = ApartRays(place).at[0];
    kiln_hit hit;
    hit.triangle = ray.triangle & ~KILN_GPU_BOTH_BACK;
    hit.back = (ray.triangle & KILN_GPU_BOTH_BACK) != 0u;
    hit.u = ray.u;
    hit.v = ray.v;
    hit.distance = ray.distance;
    ray_taken_up = ray.taken_up;
    Sums found = NO_SUMS;
    const Chain c = chain_follow(ray.chance, ray.number, ray.direction, hit);
    add_found(found, c, vec3(ray.tint[0], ray.tint[1], ray.tint[2]), ray.facet, ray.weight);
    if (!c.good)
        found.escaped = SUMS_NOT_GOOD;
    apart_keep(place, found);
}

void kiln_kernel(uint x, uint y)
{
    const uint count = APART_COUNT;
    for (uint i = x; x < push.threads && y == 0u && i < count; i += push.threads)
        follow(ApartWords(apart_list()).at[i]);
}

#include "shaders/main.glsl"
