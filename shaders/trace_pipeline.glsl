/* Tracing by VK_KHR_ray_tracing_pipeline: part of shaders/trace.glsl, in ray generation shaders. One hit group (trace.rchit,
 * trace.rahit) and one miss shader (trace.rmiss) serve nearest hits and occlusion alike. */
#include "shaders/trace_payload.glsl"

layout(location = 0) rayPayloadEXT kiln_payload kiln_answer;

const float kiln_far = 3.0e38; /* a finite number stands for "no limit" */

/* Rays begin here: the device's own triangle test knows distances less well than kiln's (on an H200 rays met, from 0 on, the triangle they
 * had left: 0.3 % of all light was lost). */
float kiln_start() { return SCENE.trace.extent * (1.0 / 262144.0); }

kiln_hit kiln_trace(vec3 origin, vec3 direction)
{
    traceRayEXT(accelerationStructureEXT(SCENE.trace.top_level), gl_RayFlagsNoneEXT, 0xff, 0, 0, 0, origin, kiln_start(), direction, kiln_far, 0);
    kiln_hit hit;
    hit.back = kiln_answer.triangle_back != KILN_GPU_NONE && (kiln_answer.triangle_back & KILN_PAYLOAD_BACK) != 0u;
    hit.triangle = hit.back ? kiln_answer.triangle_back & ~KILN_PAYLOAD_BACK : kiln_answer.triangle_back;
    hit.u = kiln_answer.u;
    hit.v = kiln_answer.v;
    hit.distance = kiln_answer.distance;
    return hit;
}

bool kiln_occluded(vec3 origin, vec3 direction, float limit)
{
    if (!(limit > kiln_start())) /* traceRayEXT wants the far end not before the near one */
        return false;
    kiln_answer.triangle_back = 0u; /* stays, unless the miss shader runs */
    traceRayEXT(accelerationStructureEXT(SCENE.trace.top_level), gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipClosestHitShaderEXT,
                0xff, 0, 0, 0, origin, kiln_start(), direction, min(limit, kiln_far), 0);
    return kiln_answer.triangle_back != KILN_GPU_NONE;
}
