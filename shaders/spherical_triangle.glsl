/* A triangle as seen from a point, and directions that are even in its solid angle: worker/light/spherical_triangle.h.
 */
#ifndef KILN_SPHERICAL_TRIANGLE_GLSL
#define KILN_SPHERICAL_TRIANGLE_GLSL

#include "shaders/real.glsl"

struct kiln_spherical_triangle {
    real3 a, b, c;
    real volume, ab, ca_bc, omega;
};

kiln_spherical_triangle kiln_spherical_triangle_of(real3 to0, real3 e1, real3 e2, real area, real height)
{
    const real3 to1 = to0 + e1, to2 = to0 + e2;
    const real scale0 = 1 / length(to0), scale1 = 1 / length(to1), scale2 = 1 / length(to2);
    kiln_spherical_triangle t;
    t.a = to0 * scale0;
    t.b = to1 * scale1;
    t.c = to2 * scale2;
    t.volume = 2 * area * scale0 * (height * scale1) * scale2;
    t.ab = 1 + dot(t.a, t.b);
    t.ca_bc = dot(t.c, t.a) + dot(t.b, t.c);
    t.omega = 2 * real_atan2(t.volume, t.ab + t.ca_bc);
    return t;
}

real3 kiln_spherical_triangle_direction(kiln_spherical_triangle t, real u, real v)
{
    real sine, cosine;
    real_sincos(u * t.omega / 2, sine, cosine);
    const real3 m = (t.volume * cosine - t.ca_bc * sine) * t.a + (t.ab * sine) * t.c;
    const real3 c2 = (2 * dot(t.a, m) / dot(m, m)) * m - t.a;
    const real d = dot(c2, t.b), drop = v * (1 - d), k = sqrt(v * (2 - drop) / (1 + d));
    return k * c2 + (1 - drop - d * k) * t.b;
}

#endif
