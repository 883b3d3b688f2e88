#include "coordinator/export/glb_build.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

enum { GLB_HEADER = 12, CHUNK_HEADER = 8, PIECE_ALIGNMENT = 8 };

static void no_memory(struct kiln_glb_build *b)
{
    if (b->status == KILN_OK)
        b->status = kiln_fail(b->error, KILN_SYSTEM, "out of memory: the exported scene's JSON");
}

static size_t aligned(size_t size, size_t to) { return (size + to - 1) / to * to; }

size_t kiln_glb_piece(struct kiln_glb_build *b, const void *data, size_t size)
{
    const size_t offset = b->base;
    if (b->status == KILN_OK)
        b->status = kiln_grow(&b->pieces, &b->piece_capacity, b->piece_count + 1, sizeof *b->pieces,
                              "the source's buffers", b->error);
    if (b->status != KILN_OK)
        return 0;
    b->pieces[b->piece_count++] = (struct kiln_glb_piece){data, size};
    b->base += aligned(size, PIECE_ALIGNMENT);
    return offset;
}

uint32_t kiln_glb_append(struct kiln_glb_build *b, json_t *object, const char *key, json_t *item)
{
    json_t *array = json_object_get(object, key);
    if (array == NULL && b->status == KILN_OK) {
        array = json_array();
        if (json_object_set_new(object, key, array) != 0)
            no_memory(b);
    }
    if (b->status != KILN_OK || item == NULL || json_array_append_new(array, item) != 0) {
        if (b->status != KILN_OK)
            json_decref(item);
        no_memory(b);
        return 0;
    }
    return (uint32_t)(json_array_size(array) - 1);
}

json_t *kiln_glb_object(struct kiln_glb_build *b, json_t *object, const char *key)
{
    json_t *found = json_object_get(object, key);
    if (found == NULL && b->status == KILN_OK && json_object_set_new(object, key, found = json_object()) != 0)
        no_memory(b);
    return b->status == KILN_OK && json_is_object(found) ? found : NULL;
}

void kiln_glb_set(struct kiln_glb_build *b, json_t *object, const char *key, json_t *value)
{
    if (b->status != KILN_OK)
        json_decref(value);
    else if (json_object_set_new(object, key, value) != 0)
        no_memory(b);
}

void kiln_glb_use(struct kiln_glb_build *b, const char *extension)
{
    const json_t *used = json_object_get(b->root, "extensionsUsed");
    for (size_t i = 0; i < json_array_size(used); i++)
        if (strcmp(json_string_value(json_array_get(used, i)) != NULL ? json_string_value(json_array_get(used, i)) : "",
                   extension) == 0)
            return;
    (void)kiln_glb_append(b, b->root, "extensionsUsed", json_string(extension));
}

uint32_t kiln_glb_view(struct kiln_glb_build *b, size_t size, size_t stride, int target, unsigned char **bytes)
{
    const size_t offset = aligned(b->added_size, 4);
    *bytes = NULL;
    if (b->status == KILN_OK && size > UINT32_MAX)
        b->status = kiln_fail(b->error, KILN_BAD_INPUT,
                              "%.512s: the exported scene takes more than the 4 GiB that a .glb can hold; split it",
                              b->subject);
    if (b->status == KILN_OK)
        b->status = kiln_grow(&b->added, &b->added_capacity, offset + size, 1, "the exported scene", b->error);
    if (b->status != KILN_OK)
        return 0;
    memset(b->added + b->added_size, 0, offset - b->added_size);
    b->added_size = offset + size;
    *bytes = b->added + offset;
    json_t *view = json_pack("{s:i, s:I, s:I}", "buffer", 0, "byteOffset", (json_int_t)(b->base + offset), "byteLength",
                             (json_int_t)size);
    if (stride != 0)
        kiln_glb_set(b, view, "byteStride", json_integer((json_int_t)stride));
    if (target != 0)
        kiln_glb_set(b, view, "target", json_integer(target));
    return kiln_glb_append(b, b->root, "bufferViews", view);
}

static void little32(unsigned char *at, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        at[i] = (unsigned char)(value >> (8 * i));
}

/* Describes the first buffer, which the .glb contains; others, without bytes, may follow. */
static void settle_buffer(struct kiln_glb_build *b, size_t size)
{
    json_t *buffers = json_object_get(b->root, "buffers");
    if (size == 0)
        return;
    if (buffers == NULL)
        (void)kiln_glb_append(b, b->root, "buffers", json_object());
    json_t *first = json_array_get(json_object_get(b->root, "buffers"), 0);
    kiln_glb_set(b, first, "byteLength", json_integer((json_int_t)size));
}

/* A file position: each write begins where the one before ended. */
struct out {
    int file;
    size_t at;
    const char *path;
};

static void put(struct kiln_glb_build *b, struct out *out, const void *bytes, size_t size)
{
    if (b->status == KILN_OK)
        b->status = kiln_write_all(out->file, bytes, size, out->at, out->path, b->error);
    out->at += size;
}

static void put_padding(struct kiln_glb_build *b, struct out *out, size_t size, char with)
{
    char padding[PIECE_ALIGNMENT];
    memset(padding, with, sizeof padding);
    put(b, out, padding, size);
}

static void put_chunk(struct kiln_glb_build *b, struct out *out, size_t size, uint32_t type)
{
    unsigned char header[CHUNK_HEADER];
    little32(header, (uint32_t)size);
    little32(header + 4, type);
    put(b, out, header, sizeof header);
}

static void put_buffer(struct kiln_glb_build *b, struct out *out, size_t size)
{
    for (size_t i = 0; i < b->piece_count; i++) {
        put(b, out, b->pieces[i].data, b->pieces[i].size);
        put_padding(b, out, aligned(b->pieces[i].size, PIECE_ALIGNMENT) - b->pieces[i].size, '\0');
    }
    put(b, out, b->added, b->added_size);
    put_padding(b, out, aligned(size, 4) - size, '\0');
}

int kiln_glb_build_write(struct kiln_glb_build *b, int file, const char *name)
{
    const size_t size = b->base + b->added_size;
    struct out out = {.file = file, .path = name};
    unsigned char header[GLB_HEADER];
    char *text = NULL;
    settle_buffer(b, size);
    if (b->status == KILN_OK && (text = json_dumps(b->root, JSON_COMPACT)) == NULL)
        no_memory(b);
    const size_t length = text == NULL ? 0 : strlen(text);
    const size_t whole =
        GLB_HEADER + CHUNK_HEADER + aligned(length, 4) + (size > 0 ? CHUNK_HEADER + aligned(size, 4) : 0);
    if (b->status == KILN_OK && whole > UINT32_MAX)
        b->status =
            kiln_fail(b->error, KILN_BAD_INPUT,
                      "%.512s: the exported scene takes %zu bytes, more than the 4 GiB that a .glb can hold; split it",
                      b->subject, whole);
    if (b->status == KILN_OK) {
        memcpy(header, "glTF", 4);
        little32(header + 4, 2);
        little32(header + 8, (uint32_t)whole);
        put(b, &out, header, sizeof header);
        put_chunk(b, &out, aligned(length, 4), 0x4e4f534au);
        put(b, &out, text, length);
        put_padding(b, &out, aligned(length, 4) - length, ' ');
        if (size > 0) {
            put_chunk(b, &out, aligned(size, 4), 0x004e4942u);
            put_buffer(b, &out, size);
        }
        if (b->status == KILN_OK && kiln_fsync(out.file) != 0)
            b->status = kiln_fail_errno(b->error, KILN_IO, "%.512s cannot be written", name);
    }
    free(text);
    return b->status;
}

void kiln_glb_build_free(struct kiln_glb_build *b)
{
    json_decref(b->root);
    b->root = NULL;
    kiln_free(&b->pieces);
    kiln_free(&b->added);
}
