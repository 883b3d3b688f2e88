/* Light paths that land (shaders/land.glsl), at their first surface, which has gloss: whether it is the target, the
 * density of rays there, and the densities of other techniques. Another kernel continues the paths. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_SCATTERS_GLOSS
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

#include "shaders/land.glsl"

/* Returns the path's first ray, with all that its density depends on. */
kiln_aimed_ray first_ray()
{
    return kiln_aimed_ray(path.origin, path.direction, real3(0), real(more.range), more.light,
                          real3_of(more.place_or_sums), real(more.cosine), (more.flags & KILN_GPU_LAND_HAS_PLACE) != 0u,
                          (more.flags & KILN_GPU_LAND_IS_POINT) != 0u, more.triangle);
}

/* Densities of the other techniques over the path's own density. */
kiln_caustic_landing sums_at(kiln_aimed_ray first)
{
    const Vertex v = vertex_make(hit, path.direction, true);
    const Lit lit = lit_of(v);
    const real3 from = real3(first.direction), way = real3(v.m.position) - first.place;
    return kiln_caustic_emit(techniques_connect(first.light, lit, first.place, from),
                             techniques_emission(first.light, lit, first.place, from), first.cosine, first.is_point,
                             first.has_place ? dot(way, way) : real(1), real(abs(dot(v.m.normal, v.from))));
}

void shade_surface()
{
    const kiln_aimed_ray first = first_ray();
    const real met = kiln_aim_met(more.aim, first, hit.triangle);
    real3 flux = flux_then();
    if (!(met > 0)) {
        finish(landing_of(ASTRAY, 1u), flux);
        return;
    }
    flux *= met;
    if (!has_side(hit)) {
        finish(landing_of(BLOCKED, 1u), flux);
        return;
    }
    flux *= kiln_light_range(first.range, real(hit.distance));
    LAND_PATH(slot).flux = real[3](flux.x, flux.y, flux.z);
    if (SHARES)
        keep_sums(sums_at(first));
    go_onward(slot);
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    slot = slot_of(x);
    load();
    shade_surface();
}

#include "shaders/main.glsl"
