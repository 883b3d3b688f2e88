/* Groups of lights, whose light a bake tells apart: a YAML file (--light-groups), a key a group.
 *
 *     lamps:  {lights: ["lamp*"], objects: [ceiling]}
 *     screen: {materials: [screen]}
 *     sky:    {environment: true}
 *
 * Lists name lights of KHR_lights_punctual, emitting materials, or objects, by name or pattern (a shell glob). What is
 * in no group is in `rest`, the last one, which each bake with groups has. Names have letters, digits, - and _. */
#ifndef KILN_COORDINATOR_JOB_LIGHT_GROUPS_H
#define KILN_COORDINATOR_JOB_LIGHT_GROUPS_H

#include "coordinator/job/job.h"

/* Reads the file job->light_groups and stores it in job->grouped as JSON, and its names; nothing if there is none.
 * KILN_BAD_INPUT for what is not of that shape. Not collective. */
int kiln_job_groups_read(struct kiln_job *job, struct kiln_error *error);

#endif
