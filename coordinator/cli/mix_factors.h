/* Factors of groups of lights, as kiln mix has them from --set.
 *
 * A mixture of a bake and its groups g with factors f is, for each channel,
 *
 *     w bake + sum over g (f_g - w) g,    w the least of all f_g
 *
 * which is the sum of f_g g, but for what rounding has left between the bake and the sum of its groups: that gets the
 * least factor. So with 1 for all the mixture is the bake, bit for bit; no term is negative; and what a group that is
 * alone shines on has no more rounding than its own. */
#ifndef KILN_COORDINATOR_CLI_MIX_FACTORS_H
#define KILN_COORDINATOR_CLI_MIX_FACTORS_H

#include <jansson.h>

#include "coordinator/job/job.h"

struct kiln_mix_factors {
    size_t count;
    const char **names; /* of the groups, borrowed from run.json */
    double (*of)[3];    /* of each group, RGB */
    double least[3];
};

/* The groups that run.json of a bake lists, each with its factor from job->factors. KILN_BAD_INPUT for a bake without
 * groups; KILN_USAGE for a factor that is none, and for a name that no group has, with the nearest that one has. Not
 * collective. Release with kiln_mix_factors_release. */
int kiln_mix_factors_make(struct kiln_mix_factors *factors, const struct kiln_job *job, const json_t *run,
                          struct kiln_error *error);
void kiln_mix_factors_release(struct kiln_mix_factors *factors);

/* {NAME: [R, G, B]}: a new reference. */
json_t *kiln_mix_factors_json(const struct kiln_mix_factors *factors);

#endif
