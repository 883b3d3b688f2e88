/* Tracing by VK_KHR_ray_tracing_pipeline: part of shaders/trace/trace.glsl, in ray generation shaders. One hit group
 * (trace.rchit, trace.rahit) and one miss shader (trace.rmiss) serve nearest hits and occlusion alike. */
#include "shaders/trace/alpha.glsl"
#include "shaders/trace/payload.glsl"

layout(location = 0) rayPayloadEXT kiln_payload kiln_answer;

const float kiln_far = 3.0e38; /* a finite number stands for "no limit" */

/* Least distance of hits: the device's own triangle test is less precise than kiln's (on an H200 rays hit, from
 * distance 0 on, the triangle that they had left: 0.3 % of all light was lost). */
float kiln_start() { return SCENE.trace.extent * (1.0 / 262144.0); }

/* Replaces a hit by a coincident triangle whose other side is hit (KILN_COINCIDENT; the margin is kiln_start's, since
 * the device's distances are no more precise). `cull`: flag that leaves out faces of the wrong side. */
void kiln_prefer(vec3 origin, vec3 direction, uint question, uint seed, uint cull)
{
    const kiln_payload met = kiln_answer;
    const float margin = kiln_start(), distance = uintBitsToFloat(met.distance);
    kiln_answer = kiln_payload(0u, seed, question, 0u);
    traceRayEXT(accelerationStructureEXT(SCENE.trace.top_level), cull, 0xff, 0, 0, 0, origin,
                max(distance - margin, margin), direction, distance + margin, 0);
    if (kiln_answer.triangle_back == KILN_GPU_NONE)
        kiln_answer = met;
    else if ((met.triangle_back & KILN_PAYLOAD_TINTED) != 0u)
        kiln_answer.triangle_back |= KILN_PAYLOAD_TINTED;
}

kiln_hit kiln_nearest(vec3 origin, vec3 direction, float limit, uint question, uint preferred, uint seed)
{
    if (HAS_ALPHA >= KILN_PASSAGE_MASK)
        kiln_answer = kiln_payload(0u, seed, question, 0u);
    traceRayEXT(accelerationStructureEXT(SCENE.trace.top_level), gl_RayFlagsNoneEXT, 0xff, 0, 0, 0, origin,
                kiln_start(), direction, limit, 0);
    const bool front = preferred == KILN_FRONT || (preferred == KILN_EITHER && HAS_COINCIDENT != 0u);
    if (kiln_answer.triangle_back != KILN_GPU_NONE && (front || preferred == KILN_BACK) &&
        ((kiln_answer.triangle_back & KILN_PAYLOAD_BACK) != 0u) == front)
        kiln_prefer(origin, direction, question, seed,
                    front ? gl_RayFlagsCullBackFacingTrianglesEXT : gl_RayFlagsCullFrontFacingTrianglesEXT);
    kiln_hit hit;
    hit.back = kiln_answer.triangle_back != KILN_GPU_NONE && (kiln_answer.triangle_back & KILN_PAYLOAD_BACK) != 0u;
    hit.triangle =
        kiln_answer.triangle_back == KILN_GPU_NONE ? KILN_GPU_NONE : kiln_answer.triangle_back & KILN_PAYLOAD_NUMBER;
    hit.u = uintBitsToFloat(kiln_answer.u);
    hit.v = uintBitsToFloat(kiln_answer.v);
    hit.distance = uintBitsToFloat(kiln_answer.distance);
    return hit;
}

const float KILN_ENDLESS = kiln_far;

kiln_hit kiln_trace(vec3 origin, vec3 direction, float limit, uint preferred)
{
    if (!(limit > kiln_start())) /* traceRayEXT requires near <= far */
        return kiln_hit(KILN_GPU_NONE, 0.0, 0.0, 0.0, false);
    return kiln_nearest(origin, direction, min(limit, kiln_far), KILN_SOLID, preferred, 0u);
}

kiln_hit kiln_trace_within(vec3 origin, vec3 direction, float limit, uint seed, out vec3 tint)
{
    const float far = min(limit, kiln_far);
    tint = vec3(1.0);
    if (!(far > kiln_start())) /* traceRayEXT requires near <= far */
        return kiln_hit(KILN_GPU_NONE, 0.0, 0.0, 0.0, false);
    const kiln_hit hit = kiln_nearest(origin, direction, far, KILN_BY_CHANCE, KILN_EITHER, seed);
    if (HAS_ALPHA < KILN_PASSAGE_TINT)
        return hit;
    const bool missed = hit.triangle == KILN_GPU_NONE;
    if (missed ? kiln_answer.distance == 0u : (kiln_answer.triangle_back & KILN_PAYLOAD_TINTED) == 0u)
        return hit;
    kiln_answer = kiln_payload(seed, 0u, 0u, 0u);
    traceRayEXT(accelerationStructureEXT(SCENE.trace.top_level), gl_RayFlagsSkipClosestHitShaderEXT, 0xff, 0, 0, 0,
                origin, kiln_start(), direction, missed ? far : max(hit.distance, kiln_start()), 0);
    tint = kiln_share_of(kiln_answer);
    return hit;
}

kiln_hit kiln_trace_by_chance(vec3 origin, vec3 direction, uint seed, out vec3 tint)
{
    return kiln_trace_within(origin, direction, kiln_far, seed, tint);
}

vec3 kiln_through(vec3 origin, vec3 direction, float limit)
{
    if (!(limit > kiln_start())) /* traceRayEXT requires near <= far */
        return vec3(1.0);
    kiln_answer.triangle_back = 0u; /* stays, unless the miss shader runs */
    if (HAS_ALPHA >= KILN_PASSAGE_BLEND)
        kiln_answer = kiln_payload(0u, 0u, 0u, 0u);
    traceRayEXT(accelerationStructureEXT(SCENE.trace.top_level),
                gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipClosestHitShaderEXT, 0xff, 0, 0, 0, origin,
                kiln_start(), direction, min(limit, kiln_far), 0);
    if (kiln_answer.triangle_back != KILN_GPU_NONE)
        return vec3(0.0);
    return HAS_ALPHA >= KILN_PASSAGE_BLEND ? kiln_share_of(kiln_answer) : vec3(1.0);
}

bool kiln_is_met(vec3 origin, vec3 direction, float limit, uint seed)
{
    if (HAS_ALPHA < KILN_PASSAGE_BLEND) /* no random decisions: the nearest triangle is not needed, any will do */
        return kiln_through(origin, direction, limit) == vec3(0.0);
    if (!(limit > kiln_start())) /* as in kiln_through */
        return false;
    return kiln_nearest(origin, direction, min(limit, kiln_far), KILN_BY_CHANCE, KILN_EITHER, seed).triangle !=
           KILN_GPU_NONE;
}

kiln_hit kiln_trace_either(vec3 origin, vec3 direction, float limit, bool occlusion, uint seed, out vec3 tint)
{
    if (!occlusion)
        return kiln_trace_within(origin, direction, limit, seed, tint);
    tint = kiln_through(origin, direction, limit);
    return kiln_hit(KILN_GPU_NONE, 0.0, 0.0, 0.0, false);
}
