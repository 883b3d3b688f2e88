/* Reports of a bake with octrees on each object, like those of the lightmap writer on lightmaps. */
#ifndef KILN_COORDINATOR_BAKE_LEAF_MEANS_H
#define KILN_COORDINATOR_BAKE_LEAF_MEANS_H

#include "coordinator/field/result.h"
#include "coordinator/output/map/write/lightmaps.h"

/* Collective. Fills in reports[object] for the leaves of each object's fronts, on all ranks alike: valid, mean, error
 * and mean_error, as lightmaps.h says, and texels_per_metre, the square root of leaves / area, 1/m. The rest stays as
 * it is. `reports` has one entry for each object at least. `power`: luminance of the lights' power, W, by which the
 * steps of the sums are chosen. The same bits for any number of ranks. */
int kiln_leaf_means(struct kiln_lightmap_report *reports, const struct kiln_bake_result *result, double power,
                    struct kiln_error *error);

#endif
