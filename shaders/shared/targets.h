/* Targets of light paths from afar: what is seen of a sphere or a box, and places on it (worker/light/targets.h). */
#ifndef KILN_SHADERS_SHARED_TARGETS_H
#define KILN_SHADERS_SHARED_TARGETS_H

#include "shaders/shared/sphere.h"

struct kiln_target {
    kiln_real3 centre;     /* of sphere and box, m from the scene's centre */
    kiln_real3 low, high;  /* the box's corners, m */
    kiln_real radius;      /* of the sphere, m */
    kiln_real area;        /* m2, of the triangles, where rays go evenly over them, */
    KILN_U32 first, count; /* and where they are listed */
#ifndef KILN_GLSL
    double even; /* the part of its rays that go evenly over its triangles */
    uint32_t object;
#endif
};

/* m2, of the sphere. */
KILN_FUNCTION kiln_real kiln_target_disc(KILN_IN(KILN_STRUCT kiln_target) t)
{
    return KILN_REAL_PI * KILN_AT(t).radius * KILN_AT(t).radius;
}

/* m2: what each pair of the box's sides shows along a direction. */
KILN_FUNCTION kiln_real3 kiln_target_shades(KILN_IN(KILN_STRUCT kiln_target) t, kiln_real3 direction)
{
    const kiln_real3 size = real3_sub(KILN_AT(t).high, KILN_AT(t).low);
    return real3_make(real_abs(direction.x) * size.y * size.z, real_abs(direction.y) * size.z * size.x,
                      real_abs(direction.z) * size.x * size.y);
}

/* m2: what is seen of the sphere or of the box, whichever is less, along `direction`, unit. */
KILN_FUNCTION kiln_real kiln_target_outline(KILN_IN(KILN_STRUCT kiln_target) t, kiln_real3 direction)
{
    const kiln_real3 shades = kiln_target_shades(t, direction);
    return real_min(kiln_target_disc(t), shades.x + shades.y + shades.z);
}

/* A place on what is seen along `back`, unit, towards who looks; even over the outline. `pick`, u and v in (0, 1). */
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

/* m, from the centre: nothing of a target is farther away. */
KILN_FUNCTION kiln_real kiln_target_reach(KILN_IN(KILN_STRUCT kiln_target) t)
{
    return real_max(KILN_AT(t).radius, real3_length(real3_sub(KILN_AT(t).high, KILN_AT(t).low)) / 2);
}

/* ---- cones ---- */

/* 1 less the cosine of half the cone in which a target's sphere is seen; 2 from within. */
KILN_FUNCTION kiln_real kiln_cone_height(KILN_IN(KILN_STRUCT kiln_target) target, kiln_real3 from)
{
    const kiln_real3 to = real3_sub(KILN_AT(target).centre, from);
    const kiln_real sine2 = KILN_AT(target).radius * KILN_AT(target).radius / real3_dot(to, to);
    return sine2 < 1 ? sine2 / (1 + real_sqrt(1 - sine2)) : kiln_real_of(2);
}

/* Evenly over the cone about the axis, of which 1 less the cosine of half its angle is `height`. */
KILN_FUNCTION kiln_real3 kiln_cone_direction(kiln_real3 axis, kiln_real height, kiln_real u, kiln_real v)
{
    const kiln_real below = u * height, r = real_sqrt(below * (2 - below));
    kiln_real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, KILN_TO(sine), KILN_TO(cosine));
    return kiln_about_axis(axis, r * cosine, r * sine, 1 - below);
}

/* Per steradian, of a direction in the cone about the axis; 0 beyond it, but for rounding. */
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
