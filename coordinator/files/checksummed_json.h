/* JSON that ends with its own hash: how manifests and checkpoints say that they are whole. The last line is "xxh3_128
 * HASH", over all before it. Not collective. */
#ifndef KILN_COORDINATOR_FILES_CHECKSUMMED_JSON_H
#define KILN_COORDINATOR_FILES_CHECKSUMMED_JSON_H

#include <jansson.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

enum { KILN_HASH_TEXT = 33 };

/* An XXH3 hash of 128 bits as 32 lower-case digits. */
void kiln_hash_text(uint64_t high, uint64_t low, char text[KILN_HASH_TEXT]);
/* The same of a hash as scene files have it, low half first. NULL without memory. */
json_t *kiln_hash_json(const uint64_t hash[2]);

/* Prints `json` (flags as json_dumps takes them; NULL: KILN_SYSTEM, there was no memory to make it) and the last line.
 * *text is from kiln_allocate, *size without its zero byte. `what` is for the message. */
int kiln_seal(const json_t *json, size_t flags, char **text, size_t *size, const char *what, struct kiln_error *error);

/* The JSON before the last line; NULL when the hash is not that of the text, or it is not JSON. json_decref it. */
json_t *kiln_unseal(const char *text, size_t size);

#endif
