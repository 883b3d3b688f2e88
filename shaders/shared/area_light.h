/* Sampling of emissive triangles: sample points on them, and the ends of shadow rays. */
#ifndef KILN_SHADERS_SHARED_AREA_LIGHT_H
#define KILN_SHADERS_SHARED_AREA_LIGHT_H

#include "shaders/shared/spherical_triangle.h"

/* Limits for sampling a lone area light with one distribution for all places of a surface point
 * (worker/light/area_light_sampler.h). The first bounds the point's spread / its height above the light's plane. The
 * second bounds the cosine between the directions to two corners of the light from below: with nearly opposite corners,
 * floats lose the sum of the directions. */
#define KILN_TARGET_SPREAD_MOST KILN_RATIO(1, 8)
#define KILN_TARGET_OPPOSITE KILN_RATIO(-99, 100)

/* Smallest height of a point above the light's plane, as a multiple of the rounding of the light's corners. Below it
 * the point counts as in the plane and sees nothing of the light: a lamp flush with a ceiling does not light it. */
#define KILN_AREA_LIGHT_HEIGHT 1
#define KILN_TARGET_HEIGHT 4

/* Tests of the two limits KILN_TARGET_SPREAD_MOST and KILN_TARGET_OPPOSITE. `height`: of the point's centre above the
 * light's front, m. */
KILN_FUNCTION bool kiln_target_is_near(kiln_real height, kiln_real rounding, kiln_real spread)
{
    return height > KILN_TARGET_HEIGHT * rounding && spread <= KILN_TARGET_SPREAD_MOST * height;
}
KILN_FUNCTION bool kiln_target_is_apart(KILN_STRUCT kiln_spherical_triangle t)
{
    return real_min(real_min(real3_dot(t.a, t.b), real3_dot(t.b, t.c)), real3_dot(t.c, t.a)) > KILN_TARGET_OPPOSITE;
}

/* Samples a point on the triangle of edges e1 and e2 uniformly in area; returns it relative to corner 0. */
KILN_FUNCTION kiln_real3 kiln_triangle_place(kiln_real3 e1, kiln_real3 e2, kiln_real u, kiln_real v)
{
    const kiln_real root = real_sqrt(u);
    return real3_add(real3_scale(e1, root * (1 - v)), real3_scale(e2, root * v));
}

/* Computes the barycentric weights of corners 1 and 2 for the point `on`, relative to corner 0, in the triangle's plane
 * (Cramer's rule). They are clamped to the triangle. */
KILN_FUNCTION void kiln_triangle_weights(kiln_real3 e1, kiln_real3 e2, kiln_real3 on, KILN_OUT(kiln_real) b1,
                                         KILN_OUT(kiln_real) b2)
{
    const kiln_real e11 = real3_dot(e1, e1), e12 = real3_dot(e1, e2), e22 = real3_dot(e2, e2);
    const kiln_real below = e11 * e22 - e12 * e12, x = real3_dot(on, e1), y = real3_dot(on, e2);
    KILN_AT(b1) = real_clamp((x * e22 - y * e12) / below, kiln_real_of(0), kiln_real_of(1));
    KILN_AT(b2) = real_clamp((y * e11 - x * e12) / below, kiln_real_of(0), 1 - KILN_AT(b1));
}

/* Parts of an emitting triangle (worker/light/lamp_parts.h), by repeated bisection. Returns the bit path to the part
 * that contains a point, first step in the highest bit. A triangle (v0, v1, v2) has the halves (m, v0, v1) and (m, v2,
 * v0), with m the midpoint of the edge from v1 to v2. `turn`: the number of the corner that is v0 at first. */
#define KILN_SUBTRIANGLE_DEPTH 32u
KILN_FUNCTION KILN_U32 kiln_subtriangle_path(kiln_real b1, kiln_real b2, KILN_U32 turn)
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
    for (KILN_U32 i = 0u; i < KILN_SUBTRIANGLE_DEPTH; i++) {
        const bool second = w2 > w1;
        const kiln_real lesser = second ? w1 : w2, rest = second ? w2 - w1 : w1 - w2, kept = w0;
        path = path * 2u + (second ? 1u : 0u);
        w0 = 2 * lesser;
        w1 = second ? rest : kept;
        w2 = second ? kept : rest;
    }
    return path;
}

/* Distance before a light at which a shadow ray ends, m. The light's corners are floats with an error of `rounding`;
 * `distance` is that of the light and `cosine` that of the ray at the light. */
KILN_FUNCTION kiln_real kiln_light_backoff(kiln_real rounding, kiln_real distance, kiln_real cosine)
{
    return real_min(distance / 2, rounding / real_max(KILN_RATIO(1, 1000000), cosine));
}

/* Fraction of its length that a shadow ray is traced, so that the surface at its end does not block it: 1 - 2^-20. */
#define KILN_SHADOW_LENGTH KILN_RATIO(1048575, 1048576)

#endif
