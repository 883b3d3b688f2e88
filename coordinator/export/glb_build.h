/* A .glb under construction: its JSON and the bytes of its one buffer. The buffer begins with pieces borrowed from
 * elsewhere (a source's buffers) and continues with bytes added here. Failure is sticky: the first fault is kept in
 * `status` and `error`, and later calls do nothing and return 0. Not collective. */
#ifndef KILN_COORDINATOR_EXPORT_GLB_BUILD_H
#define KILN_COORDINATOR_EXPORT_GLB_BUILD_H

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

enum {
    KILN_GLTF_BYTE = 5120,
    KILN_GLTF_UNSIGNED_BYTE = 5121,
    KILN_GLTF_UNSIGNED_SHORT = 5123,
    KILN_GLTF_UNSIGNED_INT = 5125,
    KILN_GLTF_FLOAT = 5126
};
enum { KILN_GLTF_ARRAY_BUFFER = 34962, KILN_GLTF_ELEMENT_ARRAY_BUFFER = 34963 };

struct kiln_glb_piece {
    const void *data; /* borrowed */
    size_t size;
};

struct kiln_glb_build {
    const char *subject; /* begins error sentences */
    json_t *root;
    struct kiln_glb_piece *pieces; /* each begins at a multiple of 8 bytes */
    size_t piece_count, piece_capacity;
    size_t base; /* offset of the added bytes; must be set before any is added */
    unsigned char *added;
    size_t added_size, added_capacity;
    int status;
    struct kiln_error *error;
};

/* Appends a borrowed piece and returns its offset in the buffer. */
size_t kiln_glb_piece(struct kiln_glb_build *b, const void *data, size_t size);

/* Adds `size` bytes (not initialised), at a multiple of 4, with a buffer view of them; `stride` and `target` 0: none.
 * Returns the view's index. The pointer is valid until the next call. */
uint32_t kiln_glb_view(struct kiln_glb_build *b, size_t size, size_t stride, int target, unsigned char **bytes);

/* Appends `item` (taking its reference) to the array `key` of `object`, which is made if absent. Returns its index. */
uint32_t kiln_glb_append(struct kiln_glb_build *b, json_t *object, const char *key, json_t *item);

/* The member object `key` of `object`, made if absent; NULL if the member is not an object. Borrowed. */
json_t *kiln_glb_object(struct kiln_glb_build *b, json_t *object, const char *key);

/* Sets a member; takes the reference. */
void kiln_glb_set(struct kiln_glb_build *b, json_t *object, const char *key, json_t *value);

/* Lists an extension under extensionsUsed, once. */
void kiln_glb_use(struct kiln_glb_build *b, const char *extension);

/* Writes the open, empty file and syncs it. `name` is used in sentences. KILN_BAD_INPUT if it would exceed 4 GiB. */
int kiln_glb_build_write(struct kiln_glb_build *b, int file, const char *name);

/* Releases everything, the JSON too. */
void kiln_glb_build_free(struct kiln_glb_build *b);

#endif
