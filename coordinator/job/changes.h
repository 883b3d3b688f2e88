/* Changes of a scene's lights, colours and sky: a YAML file (--changes) with up to three keys.
 *
 *     lights:                             # of KHR_lights_punctual, by name or pattern
 *       lamp: {scale: 0.5}                # factor on the intensity, or one each for red, green and blue
 *       "spot*": {on: false}
 *       sun: {intensity: [3, 2.5, 2]}     # W/sr; of suns W/m2 on a facing surface
 *     materials:
 *       screen: {emission: [0, 1, 2]}     # radiance, W/(m2 sr), which the emission texture multiplies
 *       lava: {emission-scale: 3}         # `on: false`: it emits nothing
 *       wall: {albedo: [0.8, 0.8, 0.7]}   # base colour, 0 to 1, which the texture multiplies
 *     environment: {scale: 2}             # also on, radiance ([R, G, B]; of an image a factor), rotation (degrees)
 *
 * A file of states (--states) maps names to such changes, each relative to the scene as it is; `{}` changes nothing:
 *
 *     noon: {}
 *     evening: {lights: {sun: {on: false}}, environment: {scale: 0.1}}
 *
 * A pattern is a shell glob, as for objects (object_settings.h); one without a match is refused. The file is stored as
 * JSON of the same shape; coordinator/import/changes.h checks the keys and applies them. */
#ifndef KILN_COORDINATOR_JOB_CHANGES_H
#define KILN_COORDINATOR_JOB_CHANGES_H

#include <jansson.h>

#include "coordinator/job/job.h"

/* Reads the file job->scene.changes and stores it in job->scene.changed as JSON; does nothing without such a file.
 * KILN_BAD_INPUT, with file and line, for any other shape; KILN_NO_INPUT, KILN_PERMISSION or KILN_IO if it cannot be
 * read. */
int kiln_job_changes_read(struct kiln_job *job, struct kiln_error *error);

/* Reads the file job->relighting.states and stores it in job->relighting.stated as JSON, name: changes; does nothing
 * without such a file. Errors as above; KILN_BAD_INPUT too for names that no folder can have. */
int kiln_job_states_read(struct kiln_job *job, struct kiln_error *error);
/* Parses YAML of that shape; error messages begin with `path`. Used by the confined child that reads the files
 * (files/foreign_json.h), and for single lines. Release *json with json_decref. */
int kiln_changes_parse(const char *path, const char *text, size_t size, json_t **json, struct kiln_error *error);
/* Converts a line of `length` bytes with changes, one document of YAML or JSON, to JSON text, which the caller frees
 * with free. `where`: prefix of messages. */
int kiln_changes_line(const char *line, size_t length, const char *where, char **json_text, struct kiln_error *error);

#endif
