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

/* Parts of an emitting triangle (worker/light/lamp_parts.h): the way to the part that a place is in, the first step in
 * the highest bit. A triangle (v0, v1, v2) has the halves (m, v0, v1) and (m, v2, v0), with m the middle of the edge
 * from v1 to v2. `turn`: v0 is the triangle's corner of that number. */
#define KILN_PART_DEPTH 32u
KILN_FUNCTION KILN_U32 kiln_part_path(kiln_real b1, kiln_real b2, KILN_U32 turn)
{
    const kiln_real b0 = 1 - b1 - b2;
    kiln_real w0 = turn == 0u   ? b0
                   : turn == 1u ? b1
                                : b2,
              w1 = turn == 0u   ? b1
                   : turn == 1u ? b2
                                : b0,
              w2 = turn == 0u   ? b2
                   : turn == 1u ? b0
                                : b1;
    KILN_U32 path = 0u;
    for (KILN_U32 i = 0u; i < KILN_PART_DEPTH; i++) {
        const bool second = w2 > w1;
        const kiln_real lesser = second ? w1 : w2, rest = second ? w2 - w1 : w1 - w2, kept = w0;
        path = path * 2u + (second ? 1u : 0u);
        w0 = 2 * lesser;
        w1 = second ? rest : kept;
        w2 = second ? kept : rest;
    }
    return path;
}

/* How much before a light at `distance` a shadow ray ends, m: the light's corners are floats, off by `rounding`, and
 * the ray meets the light at this cosine. */
KILN_FUNCTION kiln_real kiln_light_backoff(kiln_real rounding, kiln_real distance, kiln_real cosine)
{
    return real_min(distance / 2, rounding / real_max(KILN_RATIO(1, 1000000), cosine));
}

/* Part of its length that a shadow ray goes: what lies at its end is not in its way. 1 - 2^-20. */
#define KILN_SHADOW_LENGTH KILN_RATIO(1048575, 1048576)

#endif
