/* Connects light vertices to camera vertices: thread x makes the shadow ray of pair `offset` + x. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 0u; /* KILN_GPU_BOTH_POINTS or not */
const bool POINTS = (METHOD & KILN_GPU_BOTH_POINTS) != 0u;

#define KILN_LIFTS
#include "shaders/bidirectional.glsl"
#include "shaders/subpaths.glsl"
#include "shaders/point_ends.glsl"

/* Evaluates the scattering at both ends in a loop, so that the long code exists once: first the camera vertex, then the
 * light vertex. `at`: where the connecting ray starts at each. */
bool scatter_both(kiln_gpu_eye_vertex eye, kiln_gpu_light_vertex kept, out Scatter s[2], out vec3 at[2],
                  out vec3 attenuated)
{
    const vec3 d = kept.position - eye.position, to_light = normalize(d);
    const bool at_point = POINTS && eye.surface == 0u;
    bool sends = true;
    attenuated = vec3(1.0);
    if (at_point) {
        s[0] = point_scatter(eye, to_light);
        at[0] = eye.position;
    }
    [[dont_unroll]] for (uint end = at_point ? 1u : 0u; end < 2u && sends; end++)
    {
        const bool far = end == 1u;
        kiln_hit hit;
        if (far)
            hit = hit_of(kept.triangle, kept.u, kept.v, 0.0);
        else
            hit = hit_of(eye.triangle, eye.u, eye.v, 0.0);
        const vec3 from = far ? kept.from : eye.from;
        Vertex v = vertex_make(hit, -from, !far && eye.surface == 0u);
        vertex_lift(far ? kept.lift : eye.lift, v);
        sends = vertex_scatter(v, far ? -to_light : from, far ? from : to_light, KILN_LOBE_ALL, s[end]);
        at[end] = vertex_start(v, far ? -to_light : to_light);
        if (far)
            attenuated = vertex_attenuation(v, -to_light, length(d));
    }
    return sends;
}

void connect(uint slot, kiln_gpu_eye_vertex eye, kiln_gpu_light_vertex kept)
{
    Scatter s[2];
    vec3 at[2], attenuated;
    if (!scatter_both(eye, kept, s, at, attenuated))
        return;
    const vec3 d = kept.position - eye.position;
    const float squared = dot(d, d);
    const bool at_point = POINTS && eye.surface == 0u;
    const Counted product =
        counted_product(s[0], !at_point, s[1].all, POINTS || kept.number > 0u ? s[1].diffuse : vec3(0.0),
                        int(BOTH.most) - int(eye.bounces) - int(kept.bounces));
    const real share = kiln_path_weight_connected(
        path_techniques(), sums_of(eye.vcm, eye.vc, eye.vm), sums_of(kept.vcm, kept.vc, kept.vm),
        real(s[0].to_light * s[1].landing_o / squared), real(s[1].to_light),
        real(point_lands(eye) ? s[1].to_eye * s[0].landing_i / squared : 0.0), real(s[0].to_eye));
    const float near = at_point ? 1.0 : s[0].cosine_i, /* the point's weights include its own cosine */
        scale = float(real(near * s[1].cosine_o / squared) * share);
    const vec3 weight = vec3_in(eye.weight), flux = vec3_in(kept.flux);
    const Counted brings = Counted(weight * (product.all * flux * attenuated * scale),
                                   weight * (product.last * flux * attenuated * scale));
    const vec2 counts = at_point ? point_counts_from(slot, eye, normalize(d)) : point_counts(slot);
    const vec3 way = at[1] - at[0];
    const float distance = length(way);
    if (shines(brings.all))
        ask_light_to(at[0], way / distance, float(real(distance) * KILN_SHADOW_LENGTH), brings, counts, slot);
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    const kiln_gpu_both_pair pair = Pairs(BOTH.pairs + 8ul * (push.offset + x)).at[0];
    connect(pair.slot, EYE_VERTEX(pair.slot), LIGHT_VERTEX(pair.other));
}

#include "shaders/main.glsl"
