/* Untrusted JSON and YAML: a confined child process (coordinator/confined/confined.h) parses the text, so that no
 * library in this process does. The child answers with the same values in a plain form, and this process checks every
 * length in it. So the result is JSON of the permitted size and depth (json_text.h), whatever the text was. The types
 * of single values are not checked here: the caller must check them. Not collective. */
#ifndef KILN_COORDINATOR_FILES_FOREIGN_JSON_H
#define KILN_COORDINATOR_FILES_FOREIGN_JSON_H

#include <jansson.h>
#include <stddef.h>

#include "worker/base/status.h"

/* The commands of the program that start the child; not for users. */
#define KILN_JSON_CHILD "json-child"
#define KILN_YAML_CHILD "yaml-child"

/* Parses `text`; `child` is one of the commands above. Release *json with json_decref. KILN_BAD_INPUT, with a sentence
 * that begins with `path`, if the text is not of that format; KILN_SYSTEM if memory is short or the child cannot be
 * started. */
int kiln_foreign_json(json_t **json, const char *child, const char *text, size_t size, const char *path,
                      struct kiln_error *error);

/* Runs the child. argv as it was spawned. `parse` parses the text, with `path` for messages; NULL: parses JSON. Returns
 * the exit status of the child. */
int kiln_foreign_json_child(int argc, char **argv,
                            int (*parse)(const char *path, const char *text, size_t size, json_t **json,
                                         struct kiln_error *error));

#endif
