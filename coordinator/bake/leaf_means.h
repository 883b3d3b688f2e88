/* Reports on each object of a bake with octrees; they correspond to the reports on lightmaps of the lightmap writer. */
#ifndef KILN_COORDINATOR_BAKE_LEAF_MEANS_H
#define KILN_COORDINATOR_BAKE_LEAF_MEANS_H

#include "coordinator/field/result.h"
#include "coordinator/output/map/write/lightmaps.h"

/* Collective. Fills in reports[object] for the octree leaves on each object's fronts, the same on all ranks: valid,
 * mean, error and mean_error, as lightmaps.h says, and texels_per_metre, the square root of leaves / area, 1/m. Other
 * fields stay unchanged. `reports` has at least one entry for each object. `power`: luminance of the lights' power, W;
 * it sets the quantization step of the sums. The bits are the same for any number of ranks. */
int kiln_leaf_means(struct kiln_lightmap_report *reports, const struct kiln_bake_result *result, double power,
                    struct kiln_error *error);

#endif
