/* Alpha and emission at places that a test asks for. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

struct Place {
    uint triangle, emission; /* emission: 0 opacity and what comes through, 1 emission */
    float u, v;
};

layout(push_constant, scalar) uniform Push
{
    KILN_ADDRESS scene, places, answers;
    uint count;
} push;

#include "shaders/material.glsl"

KILN_ARRAY(Places, Place, 4);
KILN_ARRAY(Answers, vec4, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count)
        return;
    const Place p = Places(push.places).at[x];
    vec4 answer = vec4(0.0);
    if (p.emission != 0u)
        answer.rgb = kiln_surface_emission(p.triangle, p.u, p.v);
    else {
        const kiln_passage passage = kiln_surface_passage(p.triangle, p.u, p.v);
        answer = vec4(passage.through, passage.opacity);
    }
    Answers(push.answers).at[x] = answer;
}

#include "shaders/main.glsl"
