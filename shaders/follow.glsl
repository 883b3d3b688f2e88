/* Follows chains of rays that have met gloss, in a kernel separate from the rays (gather_chains.glsl). Thread x follows
 * the chains at x, x + `threads` and so on in the list. chains.comp is for the gather pass; with KILN_WEIGHED it is for
 * the weighed pass (weighed.glsl). */
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_chains_push);
#define KILN_APART
#define APART_POINTS push.points
#define APART_SAMPLES push.samples
#define APART_ROWS push.rows
#define APART_ROOM push.room

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/gather_sums.glsl"
#ifdef KILN_WEIGHED
#    define APART_RAY_BYTES KILN_GPU_APART_WEIGHED_RAY_BYTES
#    include "shaders/weighed.glsl"
#else
#    define APART_RAY_BYTES KILN_GPU_APART_RAY_BYTES
#    include "shaders/chain.glsl"
#endif
#include "shaders/gather_chains.glsl"

void follow(uint number)
{
    const uint64_t place = apart_numbered(number);
    const kiln_gpu_apart_ray ray = ApartRays(place).at[0];
    const vec3 tint = vec3(ray.tint[0], ray.tint[1], ray.tint[2]);
    kiln_hit hit;
    hit.triangle = ray.triangle & ~KILN_GPU_BOTH_BACK;
    hit.back = (ray.triangle & KILN_GPU_BOTH_BACK) != 0u;
    hit.u = ray.u;
    hit.v = ray.v;
    hit.distance = ray.distance;
    ray_taken_up = ray.taken_up;
    Sums found = NO_SUMS;
#ifdef KILN_WEIGHED
    const kiln_gpu_apart_weighed_ray more = ApartWeighedRays(place).at[0];
    const Chain c = chain_follow_weighed(ray.chance, ray.number, ray.direction, hit, more.area);
    add_light(found, 3.14159265358979 * c.light, tint, ray.facet, ray.weight);
    found.glass = vec3(0.0);
#else
    const Chain c = chain_follow(ray.chance, ray.number, ray.direction, hit);
    add_found(found, c, tint, ray.facet, ray.weight);
#endif
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
