#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/trace/payload.glsl"

KILN_PUSH(kiln_gpu_trace_push);
layout(location = 0) rayPayloadInEXT kiln_payload kiln_answer;
hitAttributeEXT vec2 kiln_weights;

void main()
{
    uint triangle = uint(gl_PrimitiveID);
    if (gl_GeometryIndexEXT != 0) /* the second geometry has the triangles that may let rays through */
        triangle += SCENE.opaque_count;
    if (gl_HitKindEXT == gl_HitKindBackFacingTriangleEXT)
        triangle |= KILN_PAYLOAD_BACK;
    if (HAS_ALPHA == KILN_PASSAGE_TINT && kiln_answer.distance != 0u)
        triangle |= KILN_PAYLOAD_TINTED;
    kiln_answer = kiln_payload(triangle, floatBitsToUint(kiln_weights.x), floatBitsToUint(kiln_weights.y),
                               floatBitsToUint(gl_HitTEXT));
}
