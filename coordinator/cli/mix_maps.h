/* Lightmaps of a mixture of groups of lights (mix_factors.h): the lightmaps of the bake, mixed layer by layer. */
#ifndef KILN_COORDINATOR_CLI_MIX_MAPS_H
#define KILN_COORDINATOR_CLI_MIX_MAPS_H

#include "coordinator/cli/mix_factors.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/read/results.h"

struct kiln_mix_params {
    struct kiln_results *results; /* the bake */
    const char *directory;        /* of the mixture */
    const char *bake;             /* folder of the bake, for messages */
    const struct kiln_mix_factors *factors;
    struct kiln_publish_batch *batch; /* receives the files */
};

/* Mixes the lightmap `name` ("lightmaps/a.exr") and puts it into the batch. Layers of light (all, direct and indirect)
 * are mixed; layers of other data are copied. Light that the bake does not separate by groups is left out. `ratio`
 * becomes the mean luminance over gathered texels, weighted by their coverage, divided by that of the bake; 1 where the
 * bake's is 0. `object`: of run.json. Not collective. */
int kiln_mix_map(const struct kiln_mix_params *params, const char *name, const json_t *object, double *ratio,
                 struct kiln_error *error);

#endif
