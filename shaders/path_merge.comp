/* Merges photons with camera vertices: thread x processes pair `offset` + x. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 15u; /* KILN_GPU_BOTH_...: what the method does */
const bool CONNECTS = (METHOD & KILN_GPU_BOTH_CONNECTS) != 0u, OWN = (METHOD & KILN_GPU_BOTH_OWN) != 0u,
           POINTS = (METHOD & KILN_GPU_BOTH_POINTS) != 0u;

#define KILN_LIFTS
#include "shaders/bidirectional.glsl"
#include "shaders/subpaths.glsl"
#include "shaders/point_ends.glsl"

kiln_gpu_photon photon_of(uint number)
{
    if (!OWN)
        return Photons(BOTH.photons + 52ul * number).at[0];
    const kiln_gpu_light_vertex l = LIGHT_VERTEX(number);
    return kiln_gpu_photon(l.position, l.from, l.flux, l.vcm, l.vm, l.bounces, l.number);
}

/* Adds the light of a photon near the surface point itself, except light that comes directly from a lamp. */
void merge_at_point(uint slot, kiln_gpu_eye_vertex eye, kiln_gpu_photon photon)
{
    const int left = int(BOTH.most) - int(eye.bounces) - int(photon.bounces);
    const Scatter s = point_scatter(eye, photon.from);
    const real present = real(LitPoints(POINTS_THERE.points).at[POINT_PATH(slot).point].present);
    if (photon.number == 0u || left < 0 || !(s.cosine_i > 0.0) || !(present > 0)) /* 0: all of it is cut away */
        return;
    const real share = kiln_path_weight_merged(path_techniques(), sums_of(0.0, 0.0, 0.0),
                                               sums_of(photon.vcm, 0.0, photon.vm), real(s.to_light), real(0));
    const vec3 brings = vec3_in(photon.flux) * float(share / (real(BOTH.area) * present * real(s.cosine_i)));
    add_light_to(slot, Counted(brings, left == 0 ? brings : vec3(0.0)), point_counts_from(slot, eye, photon.from));
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    const kiln_gpu_both_pair pair = Pairs(BOTH.pairs + 8ul * (push.offset + x)).at[0];
    const kiln_gpu_eye_vertex eye = EYE_VERTEX(pair.slot);
    const kiln_gpu_photon photon = photon_of(pair.other);
    if (POINTS && eye.surface == 0u) {
        merge_at_point(pair.slot, eye, photon);
        return;
    }
    Vertex v = vertex_make(hit_of(eye.triangle, eye.u, eye.v, 0.0), -eye.from, eye.surface == 0u);
    Scatter s;
    vertex_lift(eye.lift, v);
    if (!vertex_scatter(v, eye.from, photon.from, CONNECTS ? KILN_LOBE_ALL : KILN_LOBE_ALL & ~v.mirrors, s) ||
        !(s.landing_i > 0.0))
        return;
    const Counted product = counted_product(s, POINTS || photon.number > 0u, vec3(1.0), vec3(0.0),
                                            int(BOTH.most) - int(eye.bounces) - int(photon.bounces));
    const real share =
        CONNECTS ? kiln_path_weight_merged(path_techniques(), sums_of(eye.vcm, eye.vc, eye.vm),
                                           sums_of(photon.vcm, 0.0, photon.vm), real(s.to_light), real(s.to_eye))
                 : real(1);
    /* both subpaths have hit the surface at random */
    const float scale = float(share / (real(BOTH.area) * real(v.opacity)));
    const vec3 weight = vec3_in(eye.weight), flux = vec3_in(photon.flux);
    add_light_to(pair.slot, Counted(weight * product.all * flux * scale, weight * product.last * flux * scale),
                 point_counts(pair.slot));
}

#include "shaders/main.glsl"
