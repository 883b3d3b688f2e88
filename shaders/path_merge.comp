/* Photons are merged with vertices of the camera's paths: thread x has pair `offset` + x. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 15u; /* KILN_GPU_BOTH_...: what the method does */
const bool CONNECTS = (METHOD & KILN_GPU_BOTH_CONNECTS) != 0u, OWN = (METHOD & KILN_GPU_BOTH_OWN) != 0u;

#include "shaders/bidirectional.glsl"
#include "shaders/subpaths.glsl"

kiln_gpu_photon photon_of(uint number)
{
    if (!OWN)
        return Photons(BOTH.photons + 52ul * number).at[0];
    const kiln_gpu_light_vertex l = LIGHT_VERTEX(number);
    return kiln_gpu_photon(l.position, l.from, l.flux, l.vcm, l.vm, l.bounces, l.number);
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    const kiln_gpu_both_pair pair = Pairs(BOTH.pairs + 8ul * (push.offset + x)).at[0];
    const kiln_gpu_eye_vertex eye = EYE_VERTEX(pair.slot);
    const kiln_gpu_photon photon = photon_of(pair.other);
    const Vertex v = vertex_make(hit_of(eye.triangle, eye.u, eye.v, 0.0), -eye.from, eye.surface == 0u);
    Scatter s;
    if (!vertex_scatter(v, eye.from, photon.from, CONNECTS ? KILN_LOBE_ALL : KILN_LOBE_ALL & ~v.mirrors, s))
        return;
    const vec3 product = scatter_product(s, photon.number > 0u, vec3(1.0), vec3(0.0),
                                         int(BOTH.most) - int(eye.bounces) - int(photon.bounces));
    const real share =
        CONNECTS ? kiln_path_weight_merged(path_techniques(), sums_of(eye.vcm, eye.vc, eye.vm),
                                           sums_of(photon.vcm, 0.0, photon.vm), real(s.to_light), real(s.to_eye))
                 : real(1);
    /* both subpaths have met the surface by chance */
    add_radiance(pair.slot, vec3_in(eye.weight) * product * vec3_in(photon.flux) *
                                float(share / (real(BOTH.area) * real(v.opacity))));
}

#include "shaders/main.glsl"
