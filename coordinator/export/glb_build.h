/* A .glb while it is being written: its JSON, and the bytes of its one buffer, which begin with pieces borrowed from
 * elsewhere (a source's buffers) and go on with what is added here. Failure is sticky: the first fault is kept in
 * `status` and `error`, later calls do nothing and return 0. Not collective. */
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
    const char *subject; /* begins sentences */
    json_t *root;
    struct kiln_glb_piece *pieces; /* each begins at a multiple of 8 bytes */
    size_t piece_count, piece_capacity;
    size_t base; /* where the added bytes begin: to be settled before any is added */
    unsigned char *added;
    size_t added_size, added_capacity;
    int status;
    struct kiln_error *error;
};

/* Appends a borrowed piece and gives its offset in the buffer. */
size_t kiln_glb_piece(struct kiln_glb_build *b, const void *data, size_t size);

/* Room for `size` bytes (not initialised), at a multiple of 4, and a buffer view of them; `stride` and `target` 0:
 * none. The pointer holds until the next call. */
uint32_t kiln_glb_view(struct kiln_glb_build *b, size_t size, size_t stride, int target, unsigned char **bytes);

/* Appends `item` (its reference is taken) to the array `key` of `object`, made when it is not there. Its index. */
uint32_t kiln_glb_append(struct kiln_glb_build *b, json_t *object, const char *key, json_t *item);

/* The member object `key` of `object`, made when it is not there; NULL when something else is. Borrowed. */
json_t *kiln_glb_object(struct kiln_glb_build *b, json_t *object, const char *key);

/* Sets a member; takes the reference. */
void kiln_glb_set(struct kiln_glb_build *b, json_t *object, const char *key, json_t *value);

/* Lists an extension under extensionsUsed, once. */
void kiln_glb_use(struct kiln_glb_build *b, const char *extension);

/* Writes the open, empty file and syncs it; `name` is for sentences. KILN_BAD_INPUT when it would pass 4 GiB. */
int kiln_glb_build_write(struct kiln_glb_build *b, int file, const char *name);

/* Releases everything, the JSON too. */
void kiln_glb_build_free(struct kiln_glb_build *b);

#endif
