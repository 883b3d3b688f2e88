/* The lightmaps of a mixture of groups of lights (mix_factors.h): those of the bake, layer by layer. */
#ifndef KILN_COORDINATOR_CLI_MIX_MAPS_H
#define KILN_COORDINATOR_CLI_MIX_MAPS_H

#include "coordinator/cli/mix_factors.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/read/results.h"

struct kiln_mix_params {
    struct kiln_results *results; /* the bake */
    const char *directory;        /* of the mixture */
    const char *bake;             /* its folder, for words */
    const struct kiln_mix_factors *factors;
    struct kiln_publish_batch *batch; /* which files are put into */
};

/* Mixes the lightmap `name` ("lightmaps/a.exr") and puts it into the batch: light, direct and indirect light; layers
 * that are of no light, as they are. Layers of light that the bake does not tell apart by groups are left out. `ratio`
 * becomes the mean luminance over gathered texels, weighed by their coverage, over that of the bake; 1 where that is 0.
 * `object`: of run.json. Not collective. */
int kiln_mix_map(const struct kiln_mix_params *params, const char *name, const json_t *object, double *ratio,
                 struct kiln_error *error);

#endif
