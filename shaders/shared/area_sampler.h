/* A lone area light as all places of one surface point see it: what its samples have in common, and the rest
 * (worker/light/area_light_sampler.h says why and when). */
#ifndef KILN_SHADERS_SHARED_AREA_SAMPLER_H
#define KILN_SHADERS_SHARED_AREA_SAMPLER_H

#include "shaders/shared/area_light.h"
#include "shaders/shared/light_structs.h"

struct kiln_area_view {
    KILN_STRUCT kiln_spherical_triangle seen; /* the light, from the centre */
    bool spherical;                           /* by solid angle, else by area */
    kiln_real3 towards; /* unit, normal to the light's plane, on the centre's side pointing at it */
    kiln_real height;   /* m: of the centre above that plane */
    kiln_real3 to0;     /* m: from the centre to the light's corner 0 */
};

/* Whether the light may be sampled so from points within `spread` metres of the centre, as far as its height tells. */
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

/* From the centre along a direction, unit, to the light's plane; `area`: m2, 1 over the density of that place on the
 * light where directions are even in solid angle. */
KILN_FUNCTION kiln_real3 kiln_area_place(KILN_IN(KILN_STRUCT kiln_area_view) v, kiln_real3 direction,
                                         KILN_OUT(kiln_real) area)
{
    const kiln_real cosine = real3_dot(direction, KILN_AT(v).towards), far = KILN_AT(v).height / cosine;
    KILN_AT(area) = far * far * KILN_AT(v).seen.omega / cosine;
    return real3_scale(direction, far);
}

/* A sample `on` the light, from the centre, as the place `from` the centre sees it, which is `to` from there; `cosine`:
 * at the light. Returns sr, 1 over the density of its direction. */
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
