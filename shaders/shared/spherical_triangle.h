/* Uniform sampling of the solid angle in which a point sees a triangle.
 *
 * Arvo, "Stratified Sampling of Spherical Triangles", 1995: of corners a b c, the point c2 on the arc from a to c cuts
 * off the share u of the solid angle, and the direction lies on the arc from b to c2. His formulas need arc cosines,
 * and lose precision in thin and in small triangles. Instead, with m = a + c2, the formula of Van Oosterom and
 * Strackee, 1983, for the triangle a b c2 is
 *
 *     tan(u omega / 2) = |a . (b x m)| / (m . (a + b))
 *
 * which is linear in m, a combination of a and c. So it gives the same c2 without an arc cosine and without differences
 * of nearly equal numbers. */
#ifndef KILN_SHADERS_SHARED_SPHERICAL_TRIANGLE_H
#define KILN_SHADERS_SHARED_SPHERICAL_TRIANGLE_H

#include "shaders/shared/real.h"

struct kiln_spherical_triangle {
    kiln_real3 a, b, c;          /* unit: to the corners */
    kiln_real volume, ab, ca_bc; /* |a . (b x c)|; 1 + a . b; c . a + b . c */
    kiln_real omega;             /* sr */
};

/* sr: smaller triangles are better sampled by area, where the density varies little. */
#define KILN_SPHERICAL_FROM KILN_RATIO(2, 100)
/* Exception: long triangles, however thin, are sampled by solid angle, as the area density varies much along them. A
 * triangle is long if two corners are farther apart than 18 degrees, the angle of this cosine; half a square of less
 * than 0.02 sr is not. Below the last value, sr, floats cannot resolve the triangle. */
#define KILN_SPHERICAL_LONG KILN_RATIO(95, 100)
#define KILN_SPHERICAL_LEAST KILN_RATIO(1, 1000000000)

/* Makes a triangle of `area` m2 in a plane `height` > 0 m away. `to0` leads to corner 0, e1 and e2 are the edges from
 * there, in metres. */
KILN_FUNCTION KILN_STRUCT kiln_spherical_triangle kiln_spherical_triangle_of(kiln_real3 to0, kiln_real3 e1,
                                                                             kiln_real3 e2, kiln_real area,
                                                                             kiln_real height)
{
    const kiln_real3 to1 = real3_add(to0, e1), to2 = real3_add(to0, e2);
    const kiln_real length0 = real3_length(to0), length1 = real3_length(to1), length2 = real3_length(to2);
    const kiln_real scale0 = 1 / length0, scale1 = 1 / length1, scale2 = 1 / length2;
    KILN_STRUCT kiln_spherical_triangle t;
    t.a = real3_scale(to0, scale0);
    t.b = real3_scale(to1, scale1);
    t.c = real3_scale(to2, scale2);
    /* no cancellation; GPUs multiply by known reciprocals instead of dividing again */
#ifdef KILN_GLSL
    t.volume = 2 * area * scale0 * (height * scale1) * scale2;
#else
    t.volume = 2 * area / length0 * (height / length1) / length2;
#endif
    t.ab = 1 + real3_dot(t.a, t.b);
    t.ca_bc = real3_dot(t.c, t.a) + real3_dot(t.b, t.c);
    t.omega = 2 * real_atan2(t.volume, t.ab + t.ca_bc);
    return t;
}

/* Whether the triangle is sampled uniformly in its solid angle; else in its area. */
KILN_FUNCTION bool kiln_spherical_triangle_wanted(KILN_STRUCT kiln_spherical_triangle t)
{
    if (t.omega > KILN_SPHERICAL_FROM)
        return true;
    const kiln_real least = real_min(t.ab - 1, real_min(real3_dot(t.b, t.c), real3_dot(t.c, t.a)));
    return t.omega > KILN_SPHERICAL_LEAST && least < KILN_SPHERICAL_LONG;
}

/* Returns the unit direction for u and v in (0, 1), from the sine and cosine of u omega / 2. */
KILN_FUNCTION kiln_real3 kiln_spherical_triangle_turn(KILN_STRUCT kiln_spherical_triangle t, kiln_real sine,
                                                      kiln_real cosine, kiln_real v)
{
    const kiln_real3 m = real3_add(real3_scale(t.a, t.volume * cosine - t.ca_bc * sine), real3_scale(t.c, t.ab * sine));
    const kiln_real3 c2 = real3_sub(real3_scale(m, 2 * real3_dot(t.a, m) / real3_dot(m, m)), t.a);
    const kiln_real d = real3_dot(c2, t.b), drop = v * (1 - d), k = real_sqrt(v * (2 - drop) / (1 + d));
    return real3_add(real3_scale(c2, k), real3_scale(t.b, 1 - drop - d * k));
}

KILN_FUNCTION kiln_real3 kiln_spherical_triangle_direction(KILN_STRUCT kiln_spherical_triangle t, kiln_real u,
                                                           kiln_real v)
{
    kiln_real sine, cosine;
    real_sincos(u * t.omega / 2, KILN_TO(sine), KILN_TO(cosine));
    return kiln_spherical_triangle_turn(t, sine, cosine, v);
}

#endif
