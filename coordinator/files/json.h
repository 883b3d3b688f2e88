/* The one JSON object of --json, and what may stand in it. */
#ifndef KILN_COORDINATOR_FILES_JSON_H
#define KILN_COORDINATOR_FILES_JSON_H

#include <jansson.h>

#include "worker/base/status.h"

/* A JSON string, with '?' for what is not UTF-8. NULL only without memory. */
json_t *kiln_json_string(const char *text);

/* Prints the object and a line feed on stdout and releases it; KILN_SYSTEM when it is NULL (there was no memory to make
 * it), KILN_IO when stdout does not take it. */
int kiln_json_print(json_t *object, struct kiln_error *error);

#endif
