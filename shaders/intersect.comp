#version 460
#extension GL_GOOGLE_include_directive : require
/* Nearest hits of any rays: kiln_backend_intersect. */
#include "shaders/kernel.glsl"
#include "shaders/shared/streams.h"

/* 1: only whether there is a hit within the distance that `hits` has already; the triangle is then 0. */
layout(constant_id = 6) const uint OCCLUSION = 0u;

KILN_PUSH(kiln_gpu_intersect_push);

#include "shaders/trace/trace.glsl"

KILN_ARRAY(IntersectVectors, vec3, 4);
KILN_ARRAY(IntersectHits, kiln_gpu_hit, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count)
        return;
    const vec3 direction = IntersectVectors(push.directions).at[x];
    vec3 origin = IntersectVectors(push.origins).at[x];
    const uvec3 o = floatBitsToUint(origin), d = floatBitsToUint(direction);
    const uint seed = kiln_ray_bits_seed(o.x, o.y, o.z, d.x, d.y, d.z);
    /* Boxes are made for origins near the world (KILN_GPU_BOX_MARGIN): others are brought closer first. */
    const float start = max(0.0, length(origin) - 1.75 * SCENE.trace.extent);
    origin += start * direction;
    if (OCCLUSION != 0u) {
        const bool occluded =
            kiln_through(origin, direction, IntersectHits(push.hits).at[x].distance - start) == vec3(0.0);
        IntersectHits(push.hits).at[x].triangle = occluded ? 0u : KILN_GPU_NONE;
        return;
    }
    vec3 tint;
    const kiln_hit hit = kiln_trace_by_chance(origin, direction, seed, tint);
    IntersectHits(push.hits).at[x] = kiln_gpu_hit(hit.triangle, hit.u, hit.v, hit.distance + start, hit.back ? 1u : 0u,
                                                  float[3](tint.x, tint.y, tint.z));
}

#include "shaders/main.glsl"
