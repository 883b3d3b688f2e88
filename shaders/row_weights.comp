/* The gather pass from rows (replay.glsl), first step, in scenes with smooth normals: computes the weights of each ray
 * of such a point about the geometric and the shading normal, which all lights share. Sample k of the chunk's point x
 * has pair x * samples + k of push.hemisphere.slices. A negative number means that the device ended a loop early. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_hemisphere_push);

uint weight_point, weight_sample; /* of the ray under way */
#define HEMISPHERE_BEGIN(index) weight_point = (index)-push.chunk.origin
#define HEMISPHERE_RAY(k) weight_sample = k
#define HEMISPHERE_SKIPS(p) ((p.flags & KILN_GPU_POINT_SMOOTH) == 0u)

struct Sums {
    uint none;
};
#define NO_SUMS Sums(0u)

#include "shaders/hemisphere.glsl"

KILN_ARRAY(WeightArray, vec2, 4);

void keep_weights(uint k, vec2 weights)
{
    WeightArray(push.hemisphere.slices + uint64_t(weight_point) * uint64_t(8u * push.hemisphere.samples)).at[k] =
        weights;
}

void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed)
{
    const vec3 soft = kiln_shading(p, normal), both = normal + soft;
    const vec3 axis = both == vec3(0.0) ? both : normalize(both);
    float cosine;
    const vec3 direction = hemisphere_cosine(axis, u, v, cosine);
    keep_weights(weight_sample, vec2(kiln_facet_weight(dot(normal, direction), dot(normal, axis), cosine),
                                     kiln_shading_weight(dot(soft, direction), cosine)));
}

void after_rays(inout Sums sums, kiln_gpu_point p, uint row, bool good)
{
    if (!good)
        keep_weights(kiln_quarter_first(row / push.hemisphere.per_quarter, push.hemisphere.samples) +
                         row % push.hemisphere.per_quarter * push.hemisphere.slice,
                     vec2(-1.0));
}

void store(Sums sums, uint x, uint row) {}

#include "shaders/main.glsl"
