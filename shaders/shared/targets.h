/* Targets of distant light paths: projected area of a sphere or box, and places on it (worker/light/targets.h). */
#ifndef KILN_SHADERS_SHARED_TARGETS_H
#define KILN_SHADERS_SHARED_TARGETS_H

#include "shaders/shared/sphere.h"

struct kiln_target {
    kiln_real3 centre;     /* of sphere and box, m from the scene's centre */
    kiln_real3 low, high;  /* the box's corners, m */
    kiln_real radius;      /* of the sphere, m */
    kiln_real area;        /* m2: area of the triangles, if rays are spread evenly over them */
    KILN_U32 first, count; /* range of the listed triangles */
#ifndef KILN_GLSL
    double even; /* share of its rays that are spread evenly over its triangles */
    uint32_t object;
#endif
};

/* Area of the sphere's disc, m2. */
KILN_FUNCTION kiln_real kiln_target_disc(KILN_IN(KILN_STRUCT kiln_target) t)
{
    return KILN_REAL_PI * KILN_AT(t).radius * KILN_AT(t).radius;
}

/* Projected areas, m2, of the box's three pairs of sides along a direction. */
KILN_FUNCTION kiln_real3 kiln_target_shades(KILN_IN(KILN_STRUCT kiln_target) t, kiln_real3 direction)
{
    const kiln_real3 size = real3_sub(KILN_AT(t).high, KILN_AT(t).low);
    return real3_make(real_abs(direction.x) * size.y * size.z, real_abs(direction.y) * size.z * size.x,
                      real_abs(direction.z) * size.x * size.y);
}

/* Projected area, m2, of the sphere or the box, whichever is less, along unit `direction`. */
KILN_FUNCTION kiln_real kiln_target_outline(KILN_IN(KILN_STRUCT kiln_target) t, kiln_real3 direction)
{
    const kiln_real3 shades = kiln_target_shades(t, direction);
    return real_min(kiln_target_disc(t), shades.x + shades.y + shades.z);
}

/* Samples a place on the visible side, uniformly over the projected area. `back`: unit, towards the viewer; `pick`, u
 * and v are in (0, 1). */
KILN_FUNCTION kiln_real3 kiln_target_place(KILN_IN(KILN_STRUCT kiln_target) t, kiln_real3 back, kiln_real pick,
                                           kiln_real u, kiln_real v)
{
    const kiln_real3 shades = kiln_target_shades(t, back), low = KILN_AT(t).low, high = KILN_AT(t).high,
                     size = real3_sub(high, low);
    const kiln_real shade = shades.x + shades.y + shades.z;
    if (!(shade < kiln_target_disc(t))) {
        const kiln_real r = KILN_AT(t).radius * real_sqrt(u);
        kiln_real sine, cosine;
        real_sincos(2 * KILN_REAL_PI * v, KILN_TO(sine), KILN_TO(cosine));
        return real3_add(KILN_AT(t).centre, kiln_about_axis(back, r * cosine, r * sine, kiln_real_of(0)));
    }
    if (pick * shade < shades.x)
        return real3_make(back.x > 0 ? high.x : low.x, low.y + u * size.y, low.z + v * size.z);
    if (pick * shade < shades.x + shades.y)
        return real3_make(low.x + u * size.x, back.y > 0 ? high.y : low.y, low.z + v * size.z);
    return real3_make(low.x + u * size.x, low.y + v * size.y, back.z > 0 ? high.z : low.z);
}

/* Radius about the centre, m, that encloses the target. */
KILN_FUNCTION kiln_real kiln_target_reach(KILN_IN(KILN_STRUCT kiln_target) t)
{
    return real_max(KILN_AT(t).radius, real3_length(real3_sub(KILN_AT(t).high, KILN_AT(t).low)) / 2);
}

/* ---- cones ---- */

/* 1 - cosine of the half-angle of the cone in which a target's sphere is seen; 2 from inside the sphere. */
KILN_FUNCTION kiln_real kiln_cone_height(KILN_IN(KILN_STRUCT kiln_target) target, kiln_real3 from)
{
    const kiln_real3 to = real3_sub(KILN_AT(target).centre, from);
    const kiln_real sine2 = KILN_AT(target).radius * KILN_AT(target).radius / real3_dot(to, to);
    return sine2 < 1 ? sine2 / (1 + real_sqrt(1 - sine2)) : kiln_real_of(2);
}

/* Samples a direction uniformly in the cone about the axis; `height` is 1 - cosine of its half-angle. */
KILN_FUNCTION kiln_real3 kiln_cone_direction(kiln_real3 axis, kiln_real height, kiln_real u, kiln_real v)
{
    const kiln_real below = u * height, r = real_sqrt(below * (2 - below));
    kiln_real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, KILN_TO(sine), KILN_TO(cosine));
    return kiln_about_axis(axis, r * cosine, r * sine, 1 - below);
}

/* Density per steradian of a direction in the cone about the axis; 0 outside, but for rounding. */
#define KILN_CONE_SLACK KILN_RATIO(10001, 10000)
KILN_FUNCTION kiln_real kiln_cone_density(kiln_real3 axis, kiln_real height, kiln_real3 direction)
{
    return 1 - real3_dot(axis, direction) <= KILN_CONE_SLACK * height ? 1 / (2 * KILN_REAL_PI * height)
                                                                      : kiln_real_of(0);
}

/* Unit. */
KILN_FUNCTION kiln_real3 kiln_target_towards(KILN_IN(KILN_STRUCT kiln_target) target, kiln_real3 from)
{
    const kiln_real3 to = real3_sub(KILN_AT(target).centre, from);
    const kiln_real far = real3_length(to);
    return far > 0 ? real3_scale(to, 1 / far) : real3_make(kiln_real_of(0), kiln_real_of(0), kiln_real_of(1));
}

#endif
