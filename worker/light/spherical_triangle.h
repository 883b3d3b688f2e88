/* A triangle as seen from a point, and directions that are even in its solid angle. Pure and thread-safe.
 *
 * Arvo, "Stratified Sampling of Spherical Triangles", 1995: of corners a b c, the point c2 on the arc from a to c cuts
 * off the share u of the solid angle, and the direction lies on the arc from b to c2. His formulas want arc cosines,
 * and lose digits in thin and in small triangles. Instead, with m = a + c2, the formula of Van Oosterom and Strackee,
 * 1983, for the triangle a b c2 is
 *
 *     tan(u omega / 2) = |a . (b x m)| / (m . (a + b))
 *
 * which is linear in m, a mix of a and c: so the same c2 comes without an arc cosine and without differences of nearly
 * equal numbers. */
#ifndef KILN_WORKER_LIGHT_SPHERICAL_TRIANGLE_H
#define KILN_WORKER_LIGHT_SPHERICAL_TRIANGLE_H

#include <math.h>

#include "worker/base/vector.h"

struct kiln_spherical_triangle {
    struct kiln_dvec3 a, b, c; /* unit: to the corners */
    double volume, ab, ca_bc;  /* |a . (b x c)|; 1 + a . b; c . a + b . c */
    double omega;              /* sr */
};

/* sr: smaller ones are better sampled by area, whose density varies little there. */
#define KILN_SPHERICAL_FROM 0.02

/* A triangle of `area` m2, whose plane is `height` > 0 m away: `to0` to corner 0, edges e1 and e2 from there, in
 * metres. */
static inline struct kiln_spherical_triangle kiln_spherical_triangle(struct kiln_dvec3 to0, struct kiln_dvec3 e1,
                                                                     struct kiln_dvec3 e2, double area, double height)
{
    const struct kiln_dvec3 to1 = dvec3_add(to0, e1), to2 = dvec3_add(to0, e2);
    const double length0 = dvec3_length(to0), length1 = dvec3_length(to1), length2 = dvec3_length(to2);
    struct kiln_spherical_triangle t = {.a = dvec3_scale(to0, 1.0 / length0),
                                        .b = dvec3_scale(to1, 1.0 / length1),
                                        .c = dvec3_scale(to2, 1.0 / length2)};
    t.volume = 2.0 * area / length0 * (height / length1) / length2; /* cancels nowhere */
    t.ab = 1.0 + dvec3_dot(t.a, t.b);
    t.ca_bc = dvec3_dot(t.c, t.a) + dvec3_dot(t.b, t.c);
    t.omega = 2.0 * atan2(t.volume, t.ab + t.ca_bc);
    return t;
}

/* Unit, for u and v in (0, 1). */
static inline struct kiln_dvec3 kiln_spherical_triangle_direction(const struct kiln_spherical_triangle *t, double u,
                                                                  double v)
{
    const double sine = sin(0.5 * u * t->omega), cosine = cos(0.5 * u * t->omega);
    const struct kiln_dvec3 m =
        dvec3_add(dvec3_scale(t->a, t->volume * cosine - t->ca_bc * sine), dvec3_scale(t->c, t->ab * sine));
    const struct kiln_dvec3 c2 = dvec3_sub(dvec3_scale(m, 2.0 * dvec3_dot(t->a, m) / dvec3_dot(m, m)), t->a);
    const double d = dvec3_dot(c2, t->b), drop = v * (1.0 - d), k = sqrt(v * (2.0 - drop) / (1.0 + d));
    return dvec3_add(dvec3_scale(c2, k), dvec3_scale(t->b, 1.0 - drop - d * k));
}

#endif
