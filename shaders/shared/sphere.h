/* Sampling of directions about an axis: uniform over the sphere, or cosine-distributed. */
#ifndef KILN_SHADERS_SHARED_SPHERE_H
#define KILN_SHADERS_SHARED_SPHERE_H

#include "shaders/shared/real.h"
#include "shaders/shared/warp.h"

#define KILN_SPHERE_DENSITY (1 / (4 * KILN_REAL_PI)) /* per steradian */

/* Unit, for u and v in (0, 1). */
KILN_FUNCTION kiln_real3 kiln_sphere_direction(kiln_real u, kiln_real v)
{
    const kiln_real z = 1 - 2 * u, r = real_sqrt(real_max(kiln_real_of(0), 1 - z * z));
    kiln_real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, KILN_TO(sine), KILN_TO(cosine));
    return real3_make(r * cosine, r * sine, z);
}

/* Turns (x, y, z) so that z lies along the unit axis; tangents are floats (kiln_basis). */
KILN_FUNCTION kiln_real3 kiln_about_axis(kiln_real3 axis, kiln_real x, kiln_real y, kiln_real z)
{
    KILN_VECTOR s, t;
    kiln_basis(KILN_TO_VECTOR(axis), KILN_TO(s), KILN_TO(t));
    return real3_add(real3_add(real3_scale(KILN_OF_VECTOR(s), x), real3_scale(KILN_OF_VECTOR(t), y)),
                     real3_scale(axis, z));
}

/* Samples a cosine-distributed direction about the unit axis, for u and v in (0, 1); its length is 1 but for rounding.
 */
KILN_FUNCTION kiln_real3 kiln_cosine_about(kiln_real3 axis, kiln_real u, kiln_real v)
{
    const kiln_real r = real_sqrt(u);
    kiln_real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, KILN_TO(sine), KILN_TO(cosine));
    return kiln_about_axis(axis, r * cosine, r * sine, real_sqrt(real_max(kiln_real_of(0), 1 - u)));
}

#endif
