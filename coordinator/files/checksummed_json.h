/* Checksummed JSON: a JSON text whose last line is "xxh3_128 HASH", the hash of all bytes before that line. Manifests
 * and checkpoints use it to show that they are complete. Not collective. */
#ifndef KILN_COORDINATOR_FILES_CHECKSUMMED_JSON_H
#define KILN_COORDINATOR_FILES_CHECKSUMMED_JSON_H

#include <jansson.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

enum { KILN_HASH_TEXT = 33 };

/* Formats a 128-bit XXH3 hash as 32 lower-case hexadecimal digits. */
void kiln_hash_text(uint64_t high, uint64_t low, char text[KILN_HASH_TEXT]);
/* The same text as a JSON string, for a hash as scene files hold it: low half first. NULL if memory is short. */
json_t *kiln_hash_json(const uint64_t hash[2]);

/* Formats `json` (with `flags` of json_dumps) and appends the last line. *text is from kiln_allocate; *size excludes
 * the zero byte at its end. `what` names the text in error messages. If `json` is NULL, because memory was short,
 * returns KILN_SYSTEM. */
int kiln_seal(const json_t *json, size_t flags, char **text, size_t *size, const char *what, struct kiln_error *error);

/* Checks the hash and parses the JSON before the last line. Parsing runs in a confined child (foreign_json.h): a forger
 * of the text can forge its hash too. Release *json with json_decref. KILN_BAD_INPUT, with a sentence that begins with
 * `path`, if the hash does not match or the text is not JSON; KILN_SYSTEM if memory is short or no child can be
 * started. */
int kiln_unseal(json_t **json, const char *text, size_t size, const char *path, struct kiln_error *error);

#endif
