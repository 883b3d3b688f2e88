/* The scene of a mixture: what shines in it has the factor of its group, so that views show lamps and sky as they are
 * mixed. Not collective. */
#ifndef KILN_COORDINATOR_CLI_MIX_SCENE_H
#define KILN_COORDINATOR_CLI_MIX_SCENE_H

#include "coordinator/cli/mix_factors.h"
#include "coordinator/output/read/results.h"

/* Publishes scene.kscene below `directory`: that of the bake, with emission, lights and environment times the factors
 * of the groups that `run`, its report, says they are in. What has parts with different factors, such as blocks of a
 * screen or patches of the sky, is as the bake had it: its name is appended to `as_baked`, an array. KILN_BAD_INPUT,
 * KILN_SYSTEM, and statuses of publishing. */
int kiln_mix_scene_write(const char *directory, const struct kiln_results *results, const json_t *run,
                         const struct kiln_mix_factors *factors, json_t *as_baked, struct kiln_error *error);

#endif
