/* Guide of a tile run (worker/pass/guided.h), made from learnt values; for both backends. */
#ifndef KILN_WORKER_BACKEND_GUIDE_H
#define KILN_WORKER_BACKEND_GUIDE_H

#include <stdbool.h>
#include <stdint.h>

#include "shaders/shared/guide.h"
#include "shaders/shared/warp.h"
#include "worker/pass/guided.h"

/* Makes the guide's density from side x side learnt values: KILN_GUIDE_SIZE floats (shaders/shared/guide.h). False: the
 * cosine is as good. */
bool kiln_guide_make(float *guide, const float *learnt, uint32_t side);

/* Returns the cell, of side x side, into which the guide warps a point (u, v), given in fractions of 2^32. */
static inline uint32_t kiln_guide_cell(const float *guide, uint32_t side, uint32_t u, uint32_t v)
{
    const uint32_t i = kiln_guide_interval(guide, 0, kiln_unit_float(u)),
                   j = kiln_guide_interval(guide, (i + 1) * KILN_GUIDE_EDGES, kiln_unit_float(v));
    return kiln_guide_coarse(i * KILN_GUIDE_SIDE + j, side);
}

#endif
