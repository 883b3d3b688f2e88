/* Sobol' points for all samples of a pass, and warps from the unit square. See shaders/shared/random.h for the
 * scrambling. */
#ifndef KILN_WORKER_SAMPLING_SEQUENCE_H
#define KILN_WORKER_SAMPLING_SEQUENCE_H

#include <stdint.h>

#include "shaders/shared/sphere.h"
#include "shaders/shared/streams.h"
#include "shaders/shared/warp.h"
#include "worker/base/status.h"
#include "worker/base/vector.h"

/* Sobol' point `index` in `dimension`, as a fraction of 2^32 (direction numbers of Joe and Kuo, 2008; the first two
 * dimensions are a (0,2)-sequence). */
uint32_t kiln_sobol(uint32_t index, uint32_t dimension);

/* Centre of the 2^-32 interval that a fraction lies in. */
static inline double kiln_unit_double(uint32_t fraction) { return ((double)fraction + 0.5) * 0x1p-32; }

/* Cosine-distributed about +z. */
struct kiln_dvec3 kiln_cosine_direction(double u, double v);

#endif
