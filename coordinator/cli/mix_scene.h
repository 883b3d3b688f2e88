/* The scene of a mixture: each source of light is scaled by the factor of its group, so that views show lamps and sky
 * as mixed. Not collective. */
#ifndef KILN_COORDINATOR_CLI_MIX_SCENE_H
#define KILN_COORDINATOR_CLI_MIX_SCENE_H

#include "coordinator/cli/mix_factors.h"
#include "coordinator/output/read/results.h"

/* Publishes scene.kscene below `directory`: the bake's scene, with emission, lights and environment times the factors
 * of their groups. `run`, the bake's report, assigns them to groups. A source with parts of different factors, such as
 * blocks of a screen or patches of the sky, stays as in the bake, and its name is appended to `as_baked`, an array.
 * KILN_BAD_INPUT, KILN_SYSTEM, and statuses of publishing. */
int kiln_mix_scene_write(const char *directory, const struct kiln_results *results, const json_t *run,
                         const struct kiln_mix_factors *factors, json_t *as_baked, struct kiln_error *error);

#endif
