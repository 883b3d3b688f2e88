/* Scattering functions of whole materials: one answer a thread, to questions of struct lobes_query
 * (tests/unit/bsdf_checks.h). The code is long, and drivers inline it: it stands here once. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "shaders/kernel.glsl"
#include "shaders/shared/bsdf.h"

struct Query {
    vec3 o, i;
    float pick, u, v;
    uint lobes, which, mode, draws, turns;
};
struct Answer {
    vec3 i, value;
    float density, backward;
    uint delta;
};

layout(push_constant, scalar) uniform Push
{
    KILN_ADDRESS scene, lobes, queries, answers;
    uint count;
}
push;

KILN_ARRAY(Lobes, kiln_bsdf_lobes, 4);
KILN_ARRAY(Queries, Query, 4);
KILN_ARRAY(Answers, Answer, 4);

/* A mirror's or smooth glass's. */
void take_mirror(kiln_bsdf_lobes l, Query q, kiln_bsdf_drawn d, inout Answer a)
{
    d.delta = true; /* what else it may be needs no code here */
    a.delta = 1u;
    a.value = d.weight;
    a.density = d.density;
    if (q.turns != 0u)
        a.backward = kiln_bsdf_reverse(l, q.o, d, q.which);
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count)
        return;
    const Query q = Queries(push.queries).at[x];
    const kiln_bsdf_lobes l = Lobes(push.lobes).at[q.lobes];
    Answer a = Answer(q.i, vec3(0.0), 0.0, 0.0, 0u);
    kiln_bsdf_choice choice = kiln_bsdf_choose(l, q.o, q.which);
    bool mirrors = false;
    if (q.draws != 0u) {
        const kiln_bsdf_drawn d = kiln_bsdf_propose(l, choice, q.o, q.pick, q.u, q.v, q.mode);
        a.i = d.i;
        mirrors = d.delta;
        if (mirrors)
            take_mirror(l, q, d, a);
    }
    const uint parts = mirrors || a.i.z == 0.0 ? 0u : q.turns != 0u ? 2u : 1u;
    [[dont_unroll]] for (uint part = 0u; part < parts; part++)
    {
        const bool back = part == 1u;
        if (back)
            choice = kiln_bsdf_choose(l, a.i, q.which);
        const kiln_bsdf_value s = kiln_bsdf_evaluate_chosen(l, choice, back ? a.i : q.o, back ? q.o : a.i,
                                                            back ? KILN_RADIANCE : q.mode, q.which);
        if (back)
            a.backward = s.density;
        else {
            a.value = s.value;
            a.density = s.density;
        }
    }
    if (q.draws != 0u && !mirrors)
        a.value = a.density > 0.0 ? a.value / a.density : vec3(0.0);
    Answers(push.answers).at[x] = a;
}

#include "shaders/main.glsl"
