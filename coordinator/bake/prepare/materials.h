/* Effect in a scene of the options about mirrors, gloss and glass (--materials, --caustics, --chain-length). Nothing
 * here is collective; the same on all ranks, for all have the same scene. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_MATERIALS_H
#define KILN_COORDINATOR_BAKE_PREPARE_MATERIALS_H

#include <jansson.h>

#include "coordinator/integrate/solution.h"
#include "coordinator/job/job.h"
#include "worker/scene/gloss.h"

/* Settles the options about materials for a scene whose gloss has been taken as the job says (kiln_scene_take_gloss).
 * Options that are "auto" become a definite choice. In a scene of which no gloss is taken, they become those of a
 * diffuse bake. So two bakes of the same light have the same options, and fields and steps that nothing needs are left
 * out. One decision comes later: where caustics are left to kiln, a first round of light paths says whether they are
 * worth computing. A second call changes nothing. */
void kiln_materials_settle(struct kiln_job *job, const struct kiln_scene *scene);

/* Refuses a scene with materials that are more than diffuse, where the method knows the diffuse part alone and nobody
 * has said that this will do. KILN_USAGE: says how many there are, names the first, and what to choose. */
int kiln_materials_check(const struct kiln_job *job, const struct kiln_scene *scene, struct kiln_error *error);

/* `materials` of run.json: the mode asked for, how many materials of each kind are taken with their gloss, and why none
 * is; of light paths, what was traced, and what a first round of them has found. `asked`: --materials as given; `job`
 * is settled. New reference. */
json_t *kiln_materials_json(const struct kiln_job *job, enum kiln_gloss_mode asked, const struct kiln_scene *scene,
                            const struct kiln_solution *solution);

#endif
