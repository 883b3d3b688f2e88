/* Parts of scattering functions, at places that a test asks for. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/bsdf.h"

struct Query {
    vec3 o;
    float alpha_x, alpha_y, eta, u, v;
};
struct Answer {
    vec3 h, i, glossy, beckmann, even, spread;
    float fresnel, facets, visible, lost, reflected, beckmann_facets, grooves;
};

layout(push_constant, scalar) uniform Push
{
    KILN_ADDRESS scene, queries, answers;
    uint count;
} push;

KILN_ARRAY(Queries, Query, 4);
KILN_ARRAY(Answers, Answer, 4);

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count)
        return;
    const Query q = Queries(push.queries).at[x];
    const kiln_interface s = kiln_interface_of(q.alpha_x, max(q.eta, 1.0 / q.eta));
    Answer a;
    a.h = kiln_ggx_sample(q.o, q.alpha_x, q.alpha_y, q.u, q.v);
    const float cosine = dot(q.o, a.h), behind = kiln_refracted_cosine(cosine, q.eta);
    a.i = kiln_refracted(q.o, a.h, 1.0 / q.eta, cosine, behind);
    a.glossy = kiln_reflected(q.o, a.h);
    a.beckmann = kiln_beckmann_sample(q.alpha_x, q.u, q.v);
    a.even = kiln_bsdf_cosine(q.u, q.v);
    a.spread = kiln_bsdf_spread_draw(q.alpha_x, q.u, q.v);
    a.fresnel = kiln_fresnel(cosine, q.eta);
    a.facets = kiln_ggx(a.even, q.alpha_x, q.alpha_y);
    a.visible = kiln_ggx_visible(q.o.z, a.even.z, kiln_ggx_stretch(q.o, q.alpha_x, q.alpha_y),
                                 kiln_ggx_stretch(a.even, q.alpha_x, q.alpha_y));
    a.lost = kiln_interface_lost(s, q.o.z);
    a.reflected = kiln_interface_albedo(s, q.o.z);
    a.beckmann_facets = kiln_beckmann(a.beckmann, q.alpha_x);
    a.grooves = kiln_grooves(q.o, a.even, a.beckmann);
    Answers(push.answers).at[x] = a;
}

#include "shaders/main.glsl"
