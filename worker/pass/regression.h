/* Surface regression on a device: the sweeps of coordinator/output/map/denoise/regression.h, for the points of one grid
 * of neighbours. It traces no rays and needs neither scene nor surface. Points are numbered by their place in the grid;
 * they are handed over, and results taken, in stretches. Results are those of the host but for rounding, which may
 * choose another fit where two are as good; they depend on the points only, not on how the work is cut up. */
#ifndef KILN_WORKER_PASS_REGRESSION_H
#define KILN_WORKER_PASS_REGRESSION_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/vector.h"
#include "shaders/shared/push.h"

struct kiln_regression_work {
    uint32_t count;        /* points, 1 at least */
    uint32_t lights;       /* 1 or 2, of each point */
    const uint32_t *cells; /* of each point */
    /* Candidates: points of cell c may have neighbours in ranges[first[c]] to ranges[first[c + 1]], without the last,
     * [begin, end) each; ascending. Borrowed. */
    size_t cell_count;
    const uint32_t *first;
    const uint32_t (*ranges)[2];
    /* Writes the points [first, first + count), and `lights` values of each, side by side. */
    void (*give)(void *context, size_t first, size_t count, struct kiln_gpu_regression_point *points,
                 struct kiln_gpu_regression_given *given);
    /* Takes the results, likewise. */
    void (*take)(void *context, size_t first, size_t count, const struct kiln_gpu_regression_result *results);
    void *context;
};

#endif
