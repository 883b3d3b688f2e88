/* The occlusion pass. Each thread traces a slice of a point's samples (hemisphere.glsl), cosine-distributed rays about
 * the shading normal, and sums up the directions without a near hit. occlusion_reduce.comp sums up the slices. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_occlusion_push);

struct Sums {
    float open;
    vec3 direction;
};

#define NO_SUMS Sums(0.0, vec3(0.0))
#include "shaders/hemisphere.glsl"

void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed)
{
    float cosine;
    const vec3 direction = hemisphere_cosine(kiln_shading(p, normal), u, v, cosine);
    const bool below = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u &&
                       (p.flags & KILN_GPU_POINT_LIFTED) == 0u && !(dot(normal, direction) > 0.0);
    if (below || kiln_is_met(position, direction, push.distance, seed))
        return;
    sums.open += 1.0;
    sums.direction += direction;
}

void after_rays(inout Sums sums, kiln_gpu_point p, uint row, bool good)
{
    if (!good)
        sums.open = -1.0e9;
}

void store(Sums sums, uint x, uint row)
{
    FloatArray floats = hemisphere_floats(row, KILN_GPU_OCCLUSION_FLOATS);
    floats.at[x] = sums.open;
    for (uint c = 0u; c < 3u; c++)
        floats.at[(1u + c) * push.chunk.total + x] = sums.direction[c];
}

#include "shaders/main.glsl"
