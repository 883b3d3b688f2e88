/* The identity of kept transport (integrate/relight/transport.h): geometry, layout and all else that says where rays go
 * and what they meet; not lights, colours or the sky. */
#ifndef KILN_COORDINATOR_BAKE_IDENTITY_TRANSPORT_IDENTITY_H
#define KILN_COORDINATOR_BAKE_IDENTITY_TRANSPORT_IDENTITY_H

#include "coordinator/bake/prepare/prepare.h"

/* Whether rays of the scene go on from mirrors, gloss or glass, or are tinted by what they pass through. */
bool kiln_transport_goes_on(const struct kiln_job *job, const struct kiln_prepared *prepared);
/* Whether rays go on from surfaces of the material, whose colour is of the transport then. */
bool kiln_transport_keeps_colour(const struct kiln_job *job, const struct kiln_prepared *prepared, uint32_t material);

/* A JSON object: numbers of the surface, and of each object hashes of its place, shape, lightmap layout and sides (with
 * opacity, and of what rays go on from). Release with json_decref. NULL if memory is short. Not collective; reads all
 * vertices. */
json_t *kiln_transport_identity(const struct kiln_job *job, const struct kiln_prepared *prepared);

/* Reads DIRECTORY/transport/index, which a bake that has kept its transport ends with: one checksummed JSON object
 * {"kiln": version, "identity": the above, "scene": path, "backend": name, "instruction set": name, "job": {option:
 * text}, "changes": {...}, "light groups": {...}}; the last two as JSON of files of --changes and --light-groups, if
 * there were any. All values have these types. Release with json_decref. KILN_NO_INPUT: the bake has kept none, or is
 * not finished; KILN_BAD_INPUT: it is damaged, or not as the manifest has it. */
int kiln_transport_index_read(json_t **index, const char *directory, struct kiln_error *error);

/* Takes those options of the bake in `directory` that say what its light is (option->of_light), where the job's command
 * line gives no others. Anybody may have written them: others are passed over, and values are checked as on the command
 * line, which is KILN_BAD_INPUT here, and against one another. */
int kiln_transport_options_take(struct kiln_job *job, const json_t *index, const char *directory,
                                struct kiln_error *error);

/* Takes the changes of that bake's scene into job->scene.changed, and its groups of lights into job->scene.grouped. */
int kiln_transport_changes_take(struct kiln_job *job, const json_t *index, const char *directory,
                                struct kiln_error *error);
int kiln_transport_groups_take(struct kiln_job *job, const json_t *index, const char *directory,
                               struct kiln_error *error);

/* KILN_BAD_INPUT, with a table of the objects that differ, if the transport in `directory` is of `then` and cannot
 * serve a scene that is `now`. */
int kiln_transport_compare(const json_t *then, const json_t *now, const char *directory, struct kiln_error *error);

/* A hash of it, of which all that is kept depends. */
uint64_t kiln_transport_key(const json_t *identity);

#endif
