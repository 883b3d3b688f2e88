/* Identity of kept transport (integrate/relight/transport.h): geometry, lightmap layout and all other data that
 * determine where rays go and what they hit. Lights, colours and the sky are not part of it. */
#ifndef KILN_COORDINATOR_BAKE_IDENTITY_TRANSPORT_IDENTITY_H
#define KILN_COORDINATOR_BAKE_IDENTITY_TRANSPORT_IDENTITY_H

#include "coordinator/bake/prepare/prepare.h"

/* Whether rays of the scene continue after mirrors, gloss or glass, or are tinted by surfaces that they pass through.
 */
bool kiln_transport_goes_on(const struct kiln_job *job, const struct kiln_prepared *prepared);
/* Whether rays continue after hitting a surface of the material. The material's colour then belongs to the transport.
 */
bool kiln_transport_keeps_colour(const struct kiln_job *job, const struct kiln_prepared *prepared, uint32_t material);

/* Makes the identity, a JSON object: counts of the surface and, for each object, hashes of its placement, shape,
 * lightmap layout and sides. Sides include opacity, and the properties of surfaces after which rays continue. Release
 * with json_decref. NULL if memory is short. Not collective; reads all vertices. */
json_t *kiln_transport_identity(const struct kiln_job *job, const struct kiln_prepared *prepared);

/* Reads DIRECTORY/transport/index, the file that a bake with kept transport writes last: one checksummed JSON object
 * {"kiln": version, "identity": see kiln_transport_identity, "scene": path, "backend": name, "instruction set": name,
 * "job": {option: text}, "parts": [...], "changes": {...}, "light groups": {...}}. "parts" is there if the scene has
 * parts (kiln_job_parts_json); the last two hold the JSON of the files of --changes and --light-groups, if there were
 * any. All values have these types. Release with json_decref. KILN_NO_INPUT: the bake has kept no transport, or is not
 * finished; KILN_BAD_INPUT: the file is damaged, or differs from the manifest. */
int kiln_transport_index_read(json_t **index, const char *directory, struct kiln_error *error);

/* Copies into the job those options of the bake in `directory` that determine its light (option->of_light), unless the
 * job's command line gives them. The index is untrusted: other options are ignored. Values are checked as on the
 * command line, and against one another; a bad one is KILN_BAD_INPUT here. */
int kiln_transport_options_take(struct kiln_job *job, const json_t *index, const char *directory,
                                struct kiln_error *error);

/* Copies the bake's scene, or the parts of it, into the job. KILN_BAD_INPUT for what is no list of parts. */
int kiln_transport_scene_take(struct kiln_job *job, const json_t *index, const char *directory,
                              struct kiln_error *error);

/* Copies the bake's scene changes into job->scene.changed, and its groups of lights into job->scene.grouped. */
int kiln_transport_changes_take(struct kiln_job *job, const json_t *index, const char *directory,
                                struct kiln_error *error);
int kiln_transport_groups_take(struct kiln_job *job, const json_t *index, const char *directory,
                               struct kiln_error *error);

/* Compares the transport in `directory`, of identity `then`, with a scene of identity `now`. KILN_BAD_INPUT if the
 * transport cannot serve that scene; the message has a table of the objects that differ. */
int kiln_transport_compare(const json_t *then, const json_t *now, const char *directory, struct kiln_error *error);

/* A hash of the identity. All kept files depend on it. */
uint64_t kiln_transport_key(const json_t *identity);

#endif
