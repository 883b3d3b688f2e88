/* Normal maps in a view: the irradiance E of a lightmap is for the shading normal n; a normal map turns the normal to
 * m. Lightmaps baked with --directional store enough of the directions of light for a factor f, E' = f E. An engine may
 * use the same formulas.
 *
 * With --directional sh1 a texel has, for each colour, spherical harmonics of bands 0 and 1 of the incident radiance.
 * They give a smoothed irradiance on any normal (worker/pass/directional.h), from which only a ratio is used:
 *
 *     f = max(0, E_sh(m)) / E_sh(n),   E_sh(n) = pi Y_00 L_00 + (2 pi / 3) sum over m of Y_1m(n) L_1m
 *
 * One lamp in direction d has E_sh(n) = I (1/4 + n.d / 2) instead of I n.d, so f is too near 1. f is exact for uniform
 * light from all directions (f = 1) and for a uniform hemisphere about n (f = (1 + n.m) / 2). For other light the error
 * is that of the missing bands 2 and up. pi Y_00 L_00 is the irradiance of uniform light from all directions. Light
 * from above n has E_sh(n) >= pi Y_00 L_00, and any light has E_sh <= 3 pi Y_00 L_00.
 *
 * With --directional dominant a texel has the unit direction d towards the light, and its directionality s: 0 for light
 * from everywhere, 1 for one lamp:
 *
 *     f = 1 + s (max(0, m.d) / (n.d) - 1)
 *
 * which is exact for one lamp (s = 1) and for uniform light from all directions (s = 0). It is also exact for a uniform
 * hemisphere about n (d = n, s = 1/2), if s is the length of the mean direction of the radiance. Unlike in some engines
 * there is no half-Lambert term, (1 + m.d) / 2: for a lamp at 60 degrees it gives 3/4 instead of 1/2.
 *
 * Both denominators, E_sh(n) and n.d, can be near 0: when light grazes the surface, or comes from below it as shading
 * and geometric normals differ. Then f - 1 is multiplied by t²; t falls linearly to 0 at 0 from 1 at E_sh(n) = pi Y_00
 * L_00 / 4 or at n.d = 1/8 (82.8 degrees). So f is continuous, f = 1 for m = n, and f is at most 12 or 8. */
#ifndef KILN_COORDINATOR_VIEW_NORMAL_MAP_H
#define KILN_COORDINATOR_VIEW_NORMAL_MAP_H

#include <stdbool.h>

#include "worker/sampling/harmonics.h"
#include "worker/scene/geometry.h"

enum { KILN_NORMAL_HARMONICS = 4 };

/* Irradiance on unit normal n from the harmonics L_00, L_1-1, L_10, L_11 of one colour's radiance. */
static inline double kiln_normal_sh_irradiance(const float sh[KILN_NORMAL_HARMONICS], struct kiln_dvec3 n)
{
    double y[KILN_HARMONICS], sum = 0.0;
    kiln_harmonics(n, y);
    for (int i = 0; i < KILN_NORMAL_HARMONICS; i++)
        sum += kiln_harmonics_cosine(i) * y[i] * (double)sh[i];
    return sum;
}

/* 1 + weight t² (after / before - 1), where t falls from 1 to 0 as `before` falls from `least` to 0. */
static inline double kiln_normal_factor(double before, double after, double least, double weight)
{
    if (!(before > 0.0 && least > 0.0 && isfinite(after)))
        return 1.0;
    const double t = fmin(1.0, before / least);
    return 1.0 + weight * t * t * (after / before - 1.0);
}

/* The factor f of one colour, by its harmonics; n and m are unit vectors. */
static inline double kiln_normal_factor_sh(const float sh[KILN_NORMAL_HARMONICS], struct kiln_dvec3 n,
                                           struct kiln_dvec3 m)
{
    const double even = kiln_normal_sh_irradiance((const float[KILN_NORMAL_HARMONICS]){sh[0], 0.0f, 0.0f, 0.0f}, n);
    const double after = fmin(fmax(kiln_normal_sh_irradiance(sh, m), 0.0), 3.0 * even);
    return kiln_normal_factor(kiln_normal_sh_irradiance(sh, n), after, even / 4.0, 1.0);
}

/* The factor f of all colours, by a direction (of any length above 0) and a directionality; n and m are unit vectors.
 */
static inline double kiln_normal_factor_dominant(struct kiln_dvec3 direction, double directionality,
                                                 struct kiln_dvec3 n, struct kiln_dvec3 m)
{
    const double length = dvec3_length(direction);
    if (!(length > 0.0) || !isfinite(length))
        return 1.0;
    const struct kiln_dvec3 d = dvec3_scale(direction, 1.0 / length);
    return kiln_normal_factor(dvec3_dot(n, d), fmax(dvec3_dot(m, d), 0.0), 0.125, fmin(fmax(directionality, 0.0), 1.0));
}

/* The normal map of a stored triangle's material; NULL: none. */
const struct kiln_normal_map *kiln_normal_map_of(const struct kiln_scene *scene, uint64_t stored_triangle);

/* Applies a normal map to the unit shading normal `n` at (u, v) of a world triangle, seen from its front: a unit
 * vector. The tangent frame comes from the triangle's texture coordinates (glTF 2.0, section 3.7.2.1: x along u, y
 * against v, both turned into the plane of n; left-handed for mirrored coordinates); TANGENT of a file is not read.
 * Returns `n` if the texture coordinates have no area and so give no frame. Thread-safe. */
struct kiln_dvec3 kiln_normal_map_apply(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                        const struct kiln_normal_map *map, uint32_t triangle, float u, float v,
                                        struct kiln_dvec3 n);

#endif
