/* Groups of lights, whose light a bake separates: a YAML file (--light-groups) with one key per group.
 *
 *     lamps:  {lights: ["lamp*"], objects: [ceiling]}
 *     screen: {materials: [screen], blocks: [16, 9]}
 *     sky:    {environment: true}
 *
 * Lists contain lights of KHR_lights_punctual, emitting materials, or objects, by name or pattern (a shell glob). A
 * group with blocks is cut into columns and rows: screen.0.0 to screen.15.8, each a group
 * (worker/light/light_groups.h). With --sky-patches each patch of the sky is a group, sky.000 and on, and so is the
 * part below the horizon, sky.ground. All other light is in `rest`, the last group, which each bake with groups has.
 * Names have letters, digits, - and _. */
#ifndef KILN_COORDINATOR_JOB_LIGHT_GROUPS_H
#define KILN_COORDINATOR_JOB_LIGHT_GROUPS_H

#include <jansson.h>

#include "coordinator/job/job.h"

/* Reads the file job->scene.light_groups, if there is one, and stores it in job->scene.grouped as JSON, which may also
 * have been set before. Stores the names of all groups in the order of the file, then patches of the sky, then `rest`;
 * no names without groups and patches. KILN_BAD_INPUT for any other shape. Not collective. */
int kiln_job_groups_read(struct kiln_job *job, struct kiln_error *error);

/* Columns and rows of a group in the file; 1 and 1 without blocks. */
void kiln_job_group_blocks(const json_t *rules, uint32_t blocks[2]);

#endif
