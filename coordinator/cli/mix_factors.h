/* Factors of groups of lights, which kiln mix gets from --set.
 *
 * A mixture of a bake and its groups g with factors f is, for each channel,
 *
 *     w bake + sum over g (f_g - w) g,    w the least of all f_g
 *
 * This is the sum of f_g g, plus w times the rounding difference between the bake and the sum of its groups. So with
 * all factors 1 the mixture is the bake, bit for bit. No term is negative. Where a single group shines, there is no
 * rounding but its own. */
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

/* Makes the list of the groups in a bake's run.json, each with its factor from job->factors. KILN_BAD_INPUT for a bake
 * without groups; KILN_USAGE for a value that is no factor, and for an unknown group name, with the nearest existing
 * name. Not collective. Release with kiln_mix_factors_release. */
int kiln_mix_factors_make(struct kiln_mix_factors *factors, const struct kiln_job *job, const json_t *run,
                          struct kiln_error *error);
void kiln_mix_factors_release(struct kiln_mix_factors *factors);

/* {NAME: [R, G, B]}: a new reference. */
json_t *kiln_mix_factors_json(const struct kiln_mix_factors *factors);

#endif
