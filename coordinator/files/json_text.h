/* Safe JSON parser for files that somebody else may have written: limits size, number of values and depth before the
 * library builds the tree, which takes up to a hundred bytes of memory for two bytes of text. Not collective. */
#ifndef KILN_COORDINATOR_FILES_JSON_TEXT_H
#define KILN_COORDINATOR_FILES_JSON_TEXT_H

#include <jansson.h>
#include <stddef.h>

#include "worker/base/status.h"

enum { KILN_JSON_BYTES_MOST = 1 << 28, KILN_JSON_VALUES_MOST = 1 << 22, KILN_JSON_DEPTH_MOST = 64 };

/* Parses `text`, which need not end with a zero byte. Release with json_decref. NULL, with a message that begins with
 * `path`, if it is not JSON, has more than KILN_JSON_VALUES_MOST values, or is nested deeper than KILN_JSON_DEPTH_MOST.
 */
json_t *kiln_json_text(const char *text, size_t size, const char *path, struct kiln_error *error);

#endif
