/* The folder of a bake as those see it who read it. Somebody else may have written it, so
 *
 * - no link is followed below the folder, and nothing but plain files is opened, without waiting for anybody (openat2,
 * O_NONBLOCK);
 * - where there is a manifest (the bake is finished), a file's size and hash are compared with it before anything takes
 * the file apart, and the descriptor that was compared is the one that is read;
 * - libraries take files apart in a child process that can open nothing (reader.h).
 *
 * Without a manifest the other two hold. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_RESULTS_H
#define KILN_COORDINATOR_OUTPUT_READ_RESULTS_H

#include <jansson.h>

#include "coordinator/field/units.h"
#include "coordinator/output/image.h"
#include "coordinator/output/manifest.h"
#include "coordinator/output/read/reader.h"

struct kiln_results;

/* Opens the folder, to which the user's own path may lead over links, and reads its manifest if there is one.
 * `directory` must live as long as the results. KILN_NO_INPUT, KILN_PERMISSION, KILN_BAD_INPUT. Close with
 * kiln_results_close, which accepts NULL inside. */
int kiln_results_open(struct kiln_results **results, const char *directory, struct kiln_error *error);
void kiln_results_close(struct kiln_results **results);

/* NULL without one. */
const struct kiln_manifest *kiln_results_manifest(const struct kiln_results *results);

/* Opens the file `name` ("lightmaps/a.exr") in the folder and compares it with the manifest. *descriptor is the
 * caller's to close, at the file's beginning. Thread-safe. KILN_NO_INPUT when it is not there; KILN_BAD_INPUT when it
 * is no plain file, behind a link, not in the manifest or not as it was written; KILN_PERMISSION. `path` receives
 * "DIR/NAME", for sentences. */
int kiln_results_file(const struct kiln_results *results, const char *name, int *descriptor, char path[],
                      struct kiln_error *error);

/* Whether there is anything of that name, as far as the folder says and not its manifest. */
bool kiln_results_has(const struct kiln_results *results, const char *name);

/* Opens a folder in the folder to list it; *descriptor is the caller's. */
int kiln_results_folder(const struct kiln_results *results, const char *name, int *descriptor,
                        struct kiln_error *error);

/* A picture of the folder, as kiln_reader_image reads it. For one thread. */
int kiln_results_image(struct kiln_results *results, const char *name, const char *const *wanted, size_t count,
                       struct kiln_image **image, struct kiln_error *error);
/* run.json and its like; json_decref it. */
int kiln_results_json(const struct kiln_results *results, const char *name, json_t **json, struct kiln_error *error);
/* All bytes of a file of at most `most`: *bytes is from kiln_allocate. */
int kiln_results_bytes(const struct kiln_results *results, const char *name, size_t most, char **bytes, size_t *size,
                       struct kiln_error *error);
/* scene.kscene; close it with kiln_scene_close. */
int kiln_results_scene(const struct kiln_results *results, struct kiln_scene **scene, struct kiln_error *error);
/* The child that takes these files apart; started when it is first asked. For one thread. */
struct kiln_reader *kiln_results_reader(struct kiln_results *results);

/* The units of a finished bake, as its run.json has them; radiometric where it does not say. */
const struct kiln_units *kiln_units_of_bake(const struct kiln_results *results);

#endif
