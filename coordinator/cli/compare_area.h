/* Error of a bake against another bake of the same scene, with each texel weighted by its area; and the number of
 * lightmap values whose bits differ. Not collective. */
#ifndef KILN_COORDINATOR_CLI_COMPARE_AREA_H
#define KILN_COORDINATOR_CLI_COMPARE_AREA_H

#include <jansson.h>

#include "worker/base/status.h"

struct kiln_results;

/* Computes the errors of the bake `a` against `b`, for --json: {"nrmse", "nrmse_direct", "nrmse_indirect",
 * "values_that_differ"}. Each nrmse is sqrt(sum of w (a - b)^2 / sum of w) over the mean of all light in b; 0 where no
 * value differs. Sums are over R, G, B and the texels of b (kiln_texels_add); w is a texel's area. If no such error can
 * be computed (other geometry, octrees, no light) the object is {"why": SENTENCE}. NULL if memory is short. */
json_t *kiln_compare_by_area(struct kiln_results *a, struct kiln_results *b);

#endif
