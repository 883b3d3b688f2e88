/* The occlusion pass: each thread takes a slice of a point's samples (hemisphere.glsl), cosine-distributed rays about
 * the shading normal, and adds up the directions in which nothing is near. occlusion_reduce.comp adds up the slices. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_occlusion_push);

struct Sums {
    float open;
    vec3 direction;
};

#include "shaders/hemisphere.glsl"

void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed)
{
    float cosine;
    const vec3 direction = hemisphere_cosine(kiln_shading(p, normal), u, v, cosine);
    const bool below = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u && !(dot(normal, direction) > 0.0);
    if (below || kiln_is_met(position, direction, push.distance, seed))
        return;
    sums.open += 1.0;
    sums.direction += direction;
}

void kiln_kernel(uint x, uint y)
{
    const Slice slice = hemisphere_slice(x, y);
    if (slice.index == KILN_GPU_NONE)
        return;
    const kiln_gpu_point p = PointArray(push.chunk.points).at[slice.index];
    Sums sums = Sums(0.0, vec3(0.0));
    if (!hemisphere_rays(sums, p, hemisphere_numbers(p), slice))
        sums.open = -1.0e9;
    FloatArray floats = hemisphere_store(slice, KILN_GPU_OCCLUSION_FLOATS);
    floats.at[0] = sums.open;
    for (uint c = 0u; c < 3u; c++)
        floats.at[(1u + c) * push.chunk.total] = sums.direction[c];
}

#include "shaders/main.glsl"
