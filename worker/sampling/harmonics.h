/* Spherical harmonics of shaders/shared/harmonics.h in double precision, and their factors for irradiance. */
#ifndef KILN_WORKER_SAMPLING_HARMONICS_H
#define KILN_WORKER_SAMPLING_HARMONICS_H

#include "shaders/shared/harmonics.h"
#include "worker/base/vector.h"

/* Basis functions for unit direction d. */
static inline void kiln_harmonics(struct kiln_dvec3 d, double y[KILN_HARMONICS])
{
#define KILN_SET(index, value) y[index] = value;
    KILN_HARMONICS_EACH(KILN_SET, d)
#undef KILN_SET
}

/* Factor from a coefficient of radiance to that of irradiance: A_l of the clamped cosine (Ramamoorthi and Hanrahan
 * 2001, equation 8). */
static inline double kiln_harmonics_cosine(int index)
{
    return index == 0 ? KILN_PI : index < 4 ? 2.0 * KILN_PI / 3.0 : KILN_PI / 4.0;
}

#endif
