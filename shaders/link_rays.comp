/* Rays for the visibility of points along their links (worker/pass/links.h): thread x traces ray x, as patches.comp
 * traces rays of pairs. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_link_rays_push);

#include "shaders/trace/trace.glsl"
#include "shaders/real.glsl"
#include "shaders/shared/area_light.h"
#include "shaders/shared/passage.h"

KILN_ARRAY(LinkRays, kiln_gpu_link_ray, 4);
KILN_ARRAY(LinkPlaces, kiln_gpu_link_place, 4);
KILN_ARRAY(FloatArray, float, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count)
        return;
    const kiln_gpu_link_ray ray = LinkRays(push.rays).at[x];
    const vec3 own = LinkPlaces(push.places).at[ray.own & ~KILN_GPU_LINK_BACK].at,
               other = LinkPlaces(push.others).at[ray.other].at;
    const bool back = (ray.own & KILN_GPU_LINK_BACK) != 0u;
    const vec3 from = back ? other : own, way = (back ? own : other) - from;
    const float apart = sqrt(dot(way, way));
    const vec3 through = kiln_through(from, way / apart, float(real(apart) * KILN_SHADOW_LENGTH));
    FloatArray floats = FloatArray(push.through);
    if (HAS_ALPHA < KILN_PASSAGE_BLEND) {
        floats.at[x] = through.r;
        return;
    }
    for (uint c = 0u; c < 3u; c++)
        floats.at[3u * x + c] = through[c];
}

#include "shaders/main.glsl"
