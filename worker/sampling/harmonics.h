/* Real spherical harmonics, bands 0..2, orthonormal, in the order 00, 1-1, 10, 11, 2-2, 2-1, 20, 21, 22 (Ramamoorthi
 * and Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001). */
#ifndef KILN_WORKER_SAMPLING_HARMONICS_H
#define KILN_WORKER_SAMPLING_HARMONICS_H

#include "worker/base/vector.h"

enum { KILN_HARMONICS = 9 };

/* Basis functions for unit direction d. */
static inline void kiln_harmonics(struct kiln_dvec3 d, double y[KILN_HARMONICS])
{
    y[0] = 0.28209479177387814;
    y[1] = 0.4886025119029199 * d.y;
    y[2] = 0.4886025119029199 * d.z;
    y[3] = 0.4886025119029199 * d.x;
    y[4] = 1.0925484305920792 * d.x * d.y;
    y[5] = 1.0925484305920792 * d.y * d.z;
    y[6] = 0.31539156525252005 * (3.0 * d.z * d.z - 1.0);
    y[7] = 1.0925484305920792 * d.x * d.z;
    y[8] = 0.5462742152960396 * (d.x * d.x - d.y * d.y);
}

/* What turns coefficients of radiance into those of irradiance: A_l of the clamped cosine (their equation 8). */
static inline double kiln_harmonics_cosine(int index)
{
    return index == 0 ? KILN_PI : index < 4 ? 2.0 * KILN_PI / 3.0 : KILN_PI / 4.0;
}

#endif
