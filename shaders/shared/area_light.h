/* Emissive triangles: where samples lie on them, and where their shadow rays end. */
#ifndef KILN_SHADERS_SHARED_AREA_LIGHT_H
#define KILN_SHADERS_SHARED_AREA_LIGHT_H

#include "shaders/shared/spherical_triangle.h"

/* A lone area light is sampled for all places of a point alike (worker/light/area_light_sampler.h) where the point's
 * spread over its height above the light's plane is at most the first, and no two corners of the light are as far apart
 * as this cosine: beyond it floats lose the sum of the corners' directions. */
#define KILN_TARGET_SPREAD_MOST KILN_RATIO(1, 8)
#define KILN_TARGET_OPPOSITE KILN_RATIO(-99, 100)

/* In the light's own plane, as far as floats tell, nothing of it is seen: a lamp laid flush on a ceiling does not light
 * it. Heights count from this many times the rounding of the light's corners on. */
#define KILN_AREA_LIGHT_HEIGHT 1
#define KILN_TARGET_HEIGHT 4

/* Whether the rule above holds; `height` of the point's centre over the light's front, m. */
KILN_FUNCTION bool kiln_target_is_near(kiln_real height, kiln_real rounding, kiln_real spread)
{
    return height > KILN_TARGET_HEIGHT * rounding && spread <= KILN_TARGET_SPREAD_MOST * height;
}
KILN_FUNCTION bool kiln_target_is_apart(KILN_STRUCT kiln_spherical_triangle t)
{
    return real_min(real_min(real3_dot(t.a, t.b), real3_dot(t.b, t.c)), real3_dot(t.c, t.a)) > KILN_TARGET_OPPOSITE;
}

/* From corner 0 to a place on the triangle of edges e1 and e2, even in area. */
KILN_FUNCTION kiln_real3 kiln_triangle_place(kiln_real3 e1, kiln_real3 e2, kiln_real u, kiln_real v)
{
    const kiln_real root = real_sqrt(u);
    return real3_add(real3_scale(e1, root * (1 - v)), real3_scale(e2, root * v));
}

/* Barycentric weights of corners 1 and 2 of the place `on` from corner 0 in the triangle's plane (Cramer's rule), held
 * within the triangle. */
KILN_FUNCTION void kiln_triangle_weights(kiln_real3 e1, kiln_real3 e2, kiln_real3 on, KILN_OUT(kiln_real) b1,
                                         KILN_OUT(kiln_real) b2)
{
    const kiln_real e11 = real3_dot(e1, e1), e12 = real3_dot(e1, e2), e22 = real3_dot(e2, e2);
    const kiln_real below = e11 * e22 - e12 * e12, x = real3_dot(on, e1), y = real3_dot(on, e2);
    KILN_AT(b1) = real_clamp((x * e22 - y * e12) / below, kiln_real_of(0), kiln_real_of(1));
    KILN_AT(b2) = real_clamp((y * e11 - x * e12) / below, kiln_real_of(0), 1 - KILN_AT(b1));
}

/* How much before a light at `distance` a shadow ray ends, m: the light's corners are floats, off by `rounding`, and
 * the ray meets the light at this cosine. */
KILN_FUNCTION kiln_real kiln_light_backoff(kiln_real rounding, kiln_real distance, kiln_real cosine)
{
    return real_min(distance / 2, rounding / real_max(KILN_RATIO(1, 1000000), cosine));
}

/* Of a shadow ray's length: what lies at its end is not in its way. 1 - 2^-20. */
#define KILN_SHADOW_LENGTH KILN_RATIO(1048575, 1048576)

#endif
