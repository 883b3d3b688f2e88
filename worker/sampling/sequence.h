/* Sobol' points for all samples of a pass, and warps from the unit square. See shaders/shared/random.h for the
 * scrambling. */
#ifndef KILN_WORKER_SAMPLING_SEQUENCE_H
#define KILN_WORKER_SAMPLING_SEQUENCE_H

#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

enum kiln_dimension {
    KILN_DIMENSION_U = 0, /* direction, or point on a light */
    KILN_DIMENSION_V = 1,
    KILN_DIMENSION_S = 2, /* position in the texel */
    KILN_DIMENSION_T = 3,
    KILN_DIMENSION_CHOICE = 4, /* which light */
    KILN_DIMENSIONS = 5
};

/* Sobol' point `index` in `dimension`, as a fraction of 2^32 (direction numbers of Joe and Kuo, 2008; the first two
 * dimensions are a (0,2)-sequence). */
uint32_t kiln_sobol(uint32_t index, uint32_t dimension);

/* Writes points 0 .. count-1 of one dimension, Owen-scrambled with `seed`. */
void kiln_sobol_scrambled(uint32_t *points, uint32_t count, uint32_t dimension, uint32_t seed);

/* Centre of the 2^-23 interval that a 32-bit fraction lies in: exact, so strictly inside (0, 1) in float (2^-24 would
 * round to 1). */
static inline float kiln_unit_float(uint32_t fraction) { return ((float)(fraction >> 9) + 0.5f) * 0x1p-23f; }
static inline double kiln_unit_double(uint32_t fraction) { return ((double)fraction + 0.5) * 0x1p-32; }

/* Orthonormal tangents of unit n (Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017). */
static inline void kiln_basis(struct kiln_vec3 n, struct kiln_vec3 *t, struct kiln_vec3 *b)
{
    const float sign = copysignf(1.0f, n.z);
    const float a = -1.0f / (sign + n.z);
    const float c = n.x * n.y * a;
    *t = vec3(1.0f + sign * n.x * n.x * a, sign * c, -sign * n.x);
    *b = vec3(c, sign + n.y * n.y * a, -n.y);
}

/* Uniform on the sphere. */
struct kiln_dvec3 kiln_sphere_direction(double u, double v);
/* Cosine-distributed about +z. */
struct kiln_dvec3 kiln_cosine_direction(double u, double v);

#endif
