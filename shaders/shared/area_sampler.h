/* Sampler of a lone area light for all places of one surface point: a common view of the light from the point's centre,
 * and the samples (worker/light/area_light_sampler.h says why and when). */
#ifndef KILN_SHADERS_SHARED_AREA_SAMPLER_H
#define KILN_SHADERS_SHARED_AREA_SAMPLER_H

#include "shaders/shared/area_light.h"
#include "shaders/shared/light_structs.h"

struct kiln_area_view {
    KILN_STRUCT kiln_spherical_triangle seen; /* the light, from the centre */
    bool spherical;                           /* sampled by solid angle, else by area */
    kiln_real3 towards; /* unit normal of the light's plane, pointing from the centre towards it */
    kiln_real height;   /* m: of the centre above that plane */
    kiln_real3 to0;     /* m: from the centre to the light's corner 0 */
};

/* Tests, by the height alone, whether the sampler may be used for places within `spread` metres of the centre. */
KILN_FUNCTION bool kiln_area_is_near(KILN_IN(KILN_STRUCT kiln_area_light) light, kiln_stored3 centre, kiln_real spread)
{
    const kiln_stored side = stored3_dot(stored3_sub(centre, KILN_AT(light).p0), KILN_AT(light).normal);
    const kiln_real height = kiln_real_of(KILN_AT(light).two_sided ? real_abs(side) : side);
    return kiln_target_is_near(height, KILN_AT(light).rounding, spread);
}

KILN_FUNCTION KILN_STRUCT kiln_area_view kiln_area_view_of(KILN_IN(KILN_STRUCT kiln_area_light) light,
                                                           kiln_stored3 centre)
{
    const kiln_stored3 to0 = stored3_sub(KILN_AT(light).p0, centre), normal = KILN_AT(light).normal;
    const kiln_stored side = -stored3_dot(to0, normal);
    KILN_STRUCT kiln_area_view v;
    v.to0 = KILN_TO_REAL3(to0);
    v.height = kiln_real_of(real_abs(side));
    v.towards = KILN_TO_REAL3(side > 0 ? stored3_negate(normal) : normal);
    v.seen = kiln_spherical_triangle_of(v.to0, KILN_AT(light).e1, KILN_AT(light).e2, KILN_AT(light).area, v.height);
    v.spherical = kiln_spherical_triangle_wanted(v.seen);
    return v;
}

/* Intersects a unit direction from the centre with the light's plane; returns the point relative to the centre. `area`
 * receives 1 / density of the point on the light, m2, for directions uniform in solid angle. */
KILN_FUNCTION kiln_real3 kiln_area_place(KILN_IN(KILN_STRUCT kiln_area_view) v, kiln_real3 direction,
                                         KILN_OUT(kiln_real) area)
{
    const kiln_real cosine = real3_dot(direction, KILN_AT(v).towards), far = KILN_AT(v).height / cosine;
    KILN_AT(area) = far * far * KILN_AT(v).seen.omega / cosine;
    return real3_scale(direction, far);
}

/* Converts a sample `on` the light to a place of the surface point; `on` and the place `from` are relative to the
 * centre. Gives the vector `to` from the place to the sample, its length, and the cosine at the light. Returns 1 /
 * density of its direction, sr. */
KILN_FUNCTION kiln_real kiln_area_see(KILN_IN(KILN_STRUCT kiln_area_view) v, kiln_real3 on, kiln_real3 from,
                                      kiln_real area, KILN_OUT(kiln_real3) to, KILN_OUT(kiln_real) distance,
                                      KILN_OUT(kiln_real) cosine)
{
    const kiln_real3 way = real3_sub(on, from);
    const kiln_real height = KILN_AT(v).height - real3_dot(from, KILN_AT(v).towards), squared = real3_dot(way, way),
                    far = real_sqrt(squared), seen = height / far;
    KILN_AT(to) = way;
    KILN_AT(distance) = far;
    KILN_AT(cosine) = seen;
    return seen * area / squared;
}

#endif
