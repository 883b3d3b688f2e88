/* Directions even over the sphere. */
#ifndef KILN_SHADERS_SHARED_SPHERE_H
#define KILN_SHADERS_SHARED_SPHERE_H

#include "shaders/shared/real.h"

#define KILN_SPHERE_DENSITY (1 / (4 * KILN_REAL_PI)) /* per steradian */

/* Unit, for u and v in (0, 1). */
KILN_FUNCTION kiln_real3 kiln_sphere_direction(kiln_real u, kiln_real v)
{
    const kiln_real z = 1 - 2 * u, r = real_sqrt(real_max(kiln_real_of(0), 1 - z * z));
    kiln_real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, KILN_TO(sine), KILN_TO(cosine));
    return real3_make(r * cosine, r * sine, z);
}

#endif
