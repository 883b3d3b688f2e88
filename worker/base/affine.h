/* Affine maps, row-major 3 x 4 in double: p' = M[0..2] p + M[3]. */
#ifndef KILN_WORKER_BASE_AFFINE_H
#define KILN_WORKER_BASE_AFFINE_H

#include <math.h>
#include <stdbool.h>

#define KILN_AFFINE_IDENTITY                                                                                           \
    {                                                                                                                  \
        1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0                                                                             \
    }

/* out = a b: b is applied first. `out` is neither of them. */
static inline void kiln_affine_multiply(const double a[12], const double b[12], double out[12])
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out[4 * r + c] =
                a[4 * r] * b[c] + a[4 * r + 1] * b[4 + c] + a[4 * r + 2] * b[8 + c] + (c == 3 ? a[4 * r + 3] : 0.0);
}

/* translation x rotation (unit quaternion x y z w) x scale */
static inline void kiln_affine_compose(const double t[3], const double q[4], const double s[3], double out[12])
{
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    const double rotation[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                                2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                                2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
            out[4 * r + c] = rotation[3 * r + c] * s[c];
        out[4 * r + 3] = t[r];
    }
}

/* Determinant of the linear part. */
static inline double kiln_affine_determinant(const double m[12])
{
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
           m[2] * (m[4] * m[9] - m[5] * m[8]);
}

/* Largest absolute value in the linear part. */
static inline double kiln_affine_size(const double m[12])
{
    double size = 0.0;
    for (int i = 0; i < 12; i++)
        size = i % 4 != 3 ? fmax(size, fabs(m[i])) : size;
    return size;
}

/* Makes a quaternion's length 1; false if that is not nearly so already. */
static inline bool kiln_quaternion_unit(double q[4])
{
    const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(fabs(length - 1.0) < 0.01))
        return false;
    for (int i = 0; i < 4; i++)
        q[i] /= length;
    return true;
}

#endif
