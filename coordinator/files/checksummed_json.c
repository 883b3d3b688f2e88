#include "coordinator/files/checksummed_json.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "coordinator/files/foreign_json.h"
#include "worker/base/memory.h"

static const char KEY[] = "xxh3_128 ";
enum { TAIL = sizeof KEY - 1 + KILN_HASH_TEXT }; /* length of the last line with its line feed, without a zero byte */

void kiln_hash_text(uint64_t high, uint64_t low, char text[KILN_HASH_TEXT])
{
    (void)snprintf(text, KILN_HASH_TEXT, "%016llx%016llx", (unsigned long long)high, (unsigned long long)low);
}

json_t *kiln_hash_json(const uint64_t hash[2])
{
    char text[KILN_HASH_TEXT];
    kiln_hash_text(hash[1], hash[0], text);
    return json_string(text);
}

static void write_tail(const char *text, size_t size, char tail[TAIL + 1])
{
    char digits[KILN_HASH_TEXT];
    const XXH128_hash_t hash = XXH3_128bits(text, size);
    kiln_hash_text(hash.high64, hash.low64, digits);
    (void)snprintf(tail, TAIL + 1, "%s%s\n", KEY, digits);
}

int kiln_seal(const json_t *json, size_t flags, char **text, size_t *size, const char *what, struct kiln_error *error)
{
    char *body = json != NULL ? json_dumps(json, flags) : NULL;
    if (body == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: %s", what);
    const size_t length = strlen(body) + 1;
    const int status = kiln_allocate(text, length + TAIL + 1, 1, what, error);
    if (status == KILN_OK) {
        (void)snprintf(*text, length + 1, "%s\n", body);
        write_tail(*text, length, *text + length);
        *size = length + TAIL;
    }
    free(body);
    return status;
}

int kiln_unseal(json_t **json, const char *text, size_t size, const char *path, struct kiln_error *error)
{
    char tail[TAIL + 1];
    *json = NULL;
    if (size >= TAIL)
        write_tail(text, size - TAIL, tail);
    return size >= TAIL && memcmp(text + size - TAIL, tail, TAIL) == 0
               ? kiln_foreign_json(json, KILN_JSON_CHILD, text, size - TAIL, path, error)
               : kiln_fail(error, KILN_BAD_INPUT, "'%s' is not as it was written: it does not end with its own hash",
                           path);
}
