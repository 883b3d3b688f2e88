/* The object whose published light has the largest error (published.h): the first place to look at in a bake.
 *
 * Its error is what 95 % of its texels stay below. Objects with less than a thousandth of all texels do not count,
 * unless all are so small. Sums are exact, so all numbers of ranks find the same. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_WORST_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_WORST_H

#include "coordinator/integrate/integrate.h"

/* Collective, after the last part. `reached`: the error of all texels as it was judged, to which those of objects are
 * scaled. Without light nothing is known. KILN_SYSTEM. */
int kiln_worst_find(const struct kiln_integrate_params *params, const struct kiln_rank_data *data, double reached,
                    struct kiln_worst_object *worst, struct kiln_error *error);

#endif
