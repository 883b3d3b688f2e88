/* Read access to the results of a bake. Somebody else may have written the folder, so
 *
 * - no link within the folder is followed, and only regular files are opened, without blocking (openat2, O_NONBLOCK);
 *
 * - if there is a manifest, that is, the bake is finished, the size and hash of a file are compared with it before the
 * file is parsed, and the descriptor that was compared is the one that is parsed;
 *
 * - libraries parse files in a child process that cannot open files (reader.h).
 *
 * Without a manifest the first and third rule hold. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_RESULTS_H
#define KILN_COORDINATOR_OUTPUT_READ_RESULTS_H

#include <jansson.h>

#include "coordinator/field/units.h"
#include "coordinator/field/field.h"
#include "coordinator/output/image.h"
#include "coordinator/output/manifest.h"
#include "coordinator/output/read/reader.h"

struct kiln_results;

/* Opens the folder and reads its manifest if there is one. The path `directory` itself may contain links, and must stay
 * valid as long as the results are open. KILN_NO_INPUT, KILN_PERMISSION, KILN_BAD_INPUT. Close with kiln_results_close;
 * *results may be NULL. */
int kiln_results_open(struct kiln_results **results, const char *directory, struct kiln_error *error);
void kiln_results_close(struct kiln_results **results);

/* The manifest, or NULL. */
const struct kiln_manifest *kiln_results_manifest(const struct kiln_results *results);

/* Opens the file `name` (such as "lightmaps/a.exr") in the folder and compares it with the manifest. *descriptor is at
 * the beginning of the file, and the caller closes it. `path` receives "DIR/NAME", for messages. Thread-safe.
 * KILN_NO_INPUT if the file is missing; KILN_BAD_INPUT if it is not a regular file, is reached through a link, is not
 * in the manifest or not as it was written; KILN_PERMISSION. */
int kiln_results_file(const struct kiln_results *results, const char *name, int *descriptor, char path[],
                      struct kiln_error *error);

/* Tells whether the folder contains an entry of this name; does not consult the manifest. */
bool kiln_results_has(const struct kiln_results *results, const char *name);

/* Opens a subfolder, to list it. The caller closes *descriptor. */
int kiln_results_folder(const struct kiln_results *results, const char *name, int *descriptor,
                        struct kiln_error *error);

/* Reads an image of the folder, or rows of its kiln.h5, with kiln_reader_image. For one thread at a time. */
int kiln_results_image(struct kiln_results *results, const char *name, const char *const *wanted, size_t count,
                       struct kiln_image **image, struct kiln_error *error);
/* The fields that a lightmap of the folder has, each with all its channels, in the order of the table
 * (coordinator/field/field.h): `fields` has room for KILN_FIELDS_MAX. All lightmaps of a bake have the same. */
int kiln_results_fields(struct kiln_results *results, const char *lightmap, const struct kiln_field **fields,
                        size_t *count, struct kiln_error *error);
/* Reads a JSON file such as run.json. Release *json with json_decref. */
int kiln_results_json(const struct kiln_results *results, const char *name, json_t **json, struct kiln_error *error);
/* Reads a file of at most `most` bytes. *bytes is from kiln_allocate. */
int kiln_results_bytes(const struct kiln_results *results, const char *name, size_t most, char **bytes, size_t *size,
                       struct kiln_error *error);
/* Opens scene.kscene. Close with kiln_scene_close. */
int kiln_results_scene(const struct kiln_results *results, struct kiln_scene **scene, struct kiln_error *error);
/* The reader for these files; its child is started when it is first used. For one thread at a time. */
struct kiln_reader *kiln_results_reader(struct kiln_results *results);

/* Units of a finished bake, from its run.json; radiometric if run.json names none. */
const struct kiln_units *kiln_units_of_bake(const struct kiln_results *results);

#endif
