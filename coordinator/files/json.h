/* The JSON object that a command prints with --json. */
#ifndef KILN_COORDINATOR_FILES_JSON_H
#define KILN_COORDINATOR_FILES_JSON_H

#include <jansson.h>

#include "worker/base/status.h"

/* A JSON string of `text`, with '?' in place of bytes that are not UTF-8. NULL only if memory is short. */
json_t *kiln_json_string(const char *text);

/* Prints the object and a line feed to stdout and releases it. KILN_SYSTEM if it is NULL, because memory was short;
 * KILN_IO if stdout cannot be written. */
int kiln_json_print(json_t *object, struct kiln_error *error);

#endif
