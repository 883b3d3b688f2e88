/* Surface regression on a device: the sweeps of coordinator/output/map/denoise/regression.h, for the points of one grid
 * of neighbours. It traces no rays and needs neither scene nor surface. Points are numbered by their place in the grid.
 * Points are supplied, and results taken, in consecutive ranges. Results are those of the host but for rounding, which
 * may select another one of two equally good fits; they depend on the points only, not on how the work is cut up. */
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
    /* Candidates for neighbours: those of a point in cell c are the points in the ranges ranges[first[c]] to
     * ranges[first[c + 1] - 1], each [begin, end), ascending. Borrowed. */
    size_t cell_count;
    const uint32_t *first;
    const uint32_t (*ranges)[2];
    /* Supplies the points [first, first + count), and `lights` values for each, side by side. */
    void (*give)(void *context, size_t first, size_t count, struct kiln_gpu_regression_point *points,
                 struct kiln_gpu_regression_given *given);
    /* Receives the results of the points [first, first + count). */
    void (*take)(void *context, size_t first, size_t count, const struct kiln_gpu_regression_result *results);
    void *context;
};

#endif
