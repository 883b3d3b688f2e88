/* Options about mirrors, gloss and glass (--materials, --caustics, --chain-length), applied to a scene. Nothing here is
 * collective; results are the same on all ranks, since all have the same scene. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_MATERIALS_H
#define KILN_COORDINATOR_BAKE_PREPARE_MATERIALS_H

#include <jansson.h>

#include "coordinator/integrate/solution.h"
#include "coordinator/job/job.h"
#include "worker/scene/gloss.h"

/* Settles the options about materials for a scene whose gloss has been taken as the job says (kiln_scene_take_gloss).
 * "auto" becomes a definite choice. If no gloss of the scene is taken, the options become those of a diffuse bake. So
 * two bakes of the same light have the same options, and unneeded fields and steps are left out. One decision comes
 * later: where kiln chooses about caustics, a first round of light paths decides whether they are worth computing. A
 * second call changes nothing. */
void kiln_materials_settle(struct kiln_job *job, const struct kiln_scene *scene);

/* Refuses a scene with non-diffuse materials if the method computes only their diffuse part and the user has not
 * accepted that. KILN_USAGE: the message counts these materials, names the first, and says what to choose. */
int kiln_materials_check(const struct kiln_job *job, const struct kiln_scene *scene, struct kiln_error *error);

/* Makes `materials` of run.json: the mode asked for, the number of materials of each kind whose gloss is taken, and why
 * none is; for light paths, the number traced and the findings of the first round. `asked`: --materials as given; `job`
 * is settled. New reference. */
json_t *kiln_materials_json(const struct kiln_job *job, enum kiln_gloss_mode asked, const struct kiln_scene *scene,
                            const struct kiln_solution *solution);

#endif
