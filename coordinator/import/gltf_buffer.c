/* The container (.glb chunks or plain JSON), buffers and buffer views. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "coordinator/import/gltf_document.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { GLB_HEADER = 12, GLB_CHUNK_HEADER = 8 };
static const uint32_t glb_magic = 0x46546c67u, glb_json = 0x4e4f534au, glb_binary = 0x004e4942u;
static const size_t containers_max = (size_t)1 << 21;

static uint32_t little32(const unsigned char *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

/* The place of a fault that concerns the container as a whole. */
#define CONTAINER ((struct gltf_place){0})

/* Counts the objects and arrays that the JSON text opens, outside strings: jansson takes about 130 to 300 bytes for
 * each. */
static size_t count_containers(const unsigned char *text, size_t size)
{
    size_t count = 0;
    bool quoted = false;
    for (size_t i = 0; i < size; i++) {
        if (text[i] == '"')
            quoted = !quoted;
        else if (text[i] == '\\' && quoted)
            i++;
        else
            count += !quoted && (text[i] == '{' || text[i] == '[');
    }
    return count;
}

static void parse_json(struct gltf *g, const unsigned char *text, size_t size)
{
    if (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0) {
        gltf_fail(g, CONTAINER, "the JSON", "begins with a byte order mark, which glTF forbids");
        return;
    }
    const size_t containers = count_containers(text, size);
    if (containers > containers_max) {
        gltf_fail(g, CONTAINER, "the JSON", "has %zu objects and arrays, more than the %zu that kiln reads", containers,
                  containers_max);
        return;
    }
    json_error_t report;
    g->root = json_loadb((const char *)text, size, JSON_REJECT_DUPLICATES, &report);
    if (g->root == NULL)
        gltf_fail(g, CONTAINER, "the JSON", "is broken at line %d, column %d: %.150s", report.line, report.column,
                  report.text);
    else if (!json_is_object(g->root))
        gltf_fail(g, CONTAINER, "the JSON", "is not an object");
}

static void open_binary(struct gltf *g)
{
    const unsigned char *bytes = g->file.data;
    const size_t size = g->file.size;
    if (size < GLB_HEADER) {
        gltf_fail(g, CONTAINER, "the GLB header", "is cut off: the file has %zu bytes", size);
        return;
    }
    if (little32(bytes + 4) != 2) {
        gltf_fail(g, CONTAINER, "the GLB container", "has version %u; kiln reads version 2", little32(bytes + 4));
        return;
    }
    if (little32(bytes + 8) != size) {
        gltf_fail(g, CONTAINER, "the GLB header", "says %u bytes, but the file has %zu", little32(bytes + 8), size);
        return;
    }
    const unsigned char *json = NULL;
    size_t json_size = 0, chunk = 0;
    for (size_t at = GLB_HEADER; at < size; chunk++) {
        if (size - at < GLB_CHUNK_HEADER) {
            gltf_fail(g, CONTAINER, "the GLB container", "ends inside the header of chunk %zu", chunk);
            return;
        }
        const uint32_t length = little32(bytes + at), type = little32(bytes + at + 4);
        at += GLB_CHUNK_HEADER;
        if (length > size - at) {
            gltf_fail(g, CONTAINER, "GLB chunk", "%zu says %u bytes, but only %zu are left", chunk, length, size - at);
            return;
        }
        if (chunk == 0 && type == glb_json) {
            json = bytes + at;
            json_size = length;
        } else if (chunk == 1 && type == glb_binary) {
            g->binary = bytes + at;
            g->binary_size = length;
        }
        at += length;
    }
    if (json == NULL)
        gltf_fail(g, CONTAINER, "the GLB container", "does not begin with a JSON chunk");
    else
        parse_json(g, json, json_size);
}

void gltf_open(struct gltf *g)
{
    gltf_take(g, kiln_confine_map(g->confine, g->builder, g->confine->name, "the scene", &g->file, g->error));
    if (g->status != KILN_OK)
        return;
    const char *dot = strrchr(g->confine->name, '.');
    const bool named_binary = dot != NULL && strcasecmp(dot, ".glb") == 0;
    if (g->file.size == 0)
        gltf_fail(g, CONTAINER, "the file", "is empty");
    else if (g->file.size >= 4 && little32(g->file.data) == glb_magic)
        open_binary(g);
    else if (named_binary)
        gltf_fail(g, CONTAINER, "the file", "does not begin with 'glTF', as a .glb does");
    else
        parse_json(g, g->file.data, g->file.size);
}

static int base64_digit(char c)
{
    if (c >= 'A' && c <= 'Z')
        return c - 'A';
    if (c >= 'a' && c <= 'z')
        return c - 'a' + 26;
    if (c >= '0' && c <= '9')
        return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
}

void gltf_decode_data(struct gltf *g, struct gltf_place place, const char *uri, unsigned char **bytes, size_t *size)
{
    const char *comma = strchr(uri, ',');
    if (comma == NULL || comma - uri < 7 || strncmp(comma - 7, ";base64", 7) != 0) {
        gltf_fail(g, place, "uri", "is a data URI that is not base64");
        return;
    }
    const char *text = comma + 1;
    size_t length = strlen(text);
    while (length > 0 && text[length - 1] == '=')
        length--;
    gltf_take(g, kiln_allocate(bytes, length / 4 * 3 + 3, 1, "an embedded buffer", g->error));
    if (g->status != KILN_OK)
        return;
    uint32_t bits = 0;
    size_t count = 0;
    for (size_t i = 0; i < length; i++) {
        const int digit = base64_digit(text[i]);
        if (digit < 0) {
            gltf_fail(g, place, "uri", "has the byte 0x%02x, which is not base64, at position %zu",
                      (unsigned)(unsigned char)text[i], (size_t)(text - uri) + i);
            return;
        }
        bits = bits << 6 | (uint32_t)digit;
        if (i % 4 != 0)
            (*bytes)[count++] = (unsigned char)(bits >> (6 - 2 * (i % 4)));
    }
    if (length % 4 == 1)
        gltf_fail(g, place, "uri", "is cut off in the middle of its base64 text");
    *size = count;
}

static void read_buffer(struct gltf *g, size_t index)
{
    const struct gltf_place place = {"buffers", index, ""};
    struct gltf_buffer *buffer = &g->buffers[index];
    const json_t *json = gltf_element(g, "buffers", index);
    const uint64_t length = gltf_needed(g, place, json, "byteLength", 1, UINT64_MAX >> 12);
    const char *uri = gltf_string(g, place, json, "uri");
    if (g->status != KILN_OK)
        return;
    if (uri == NULL) {
        if (index == 0 && g->binary != NULL) {
            buffer->data = g->binary;
            buffer->size = g->binary_size;
        } else if (gltf_extension(g, place, json, "EXT_meshopt_compression") != NULL) {
            buffer->size = (size_t)length; /* fallback buffer: access to its bytes is refused */
            return;
        } else {
            gltf_fail(g, place, "uri", "is missing and there is no GLB chunk for it");
        }
    } else if (strncmp(uri, "data:", 5) == 0) {
        gltf_decode_data(g, place, uri, &buffer->owned, &buffer->size);
        buffer->data = buffer->owned;
    } else {
        char path[1025], found[1025], where[64];
        (void)snprintf(where, sizeof where, "buffers[%zu].uri", index);
        gltf_take(g, kiln_confine_decode(g->confine, uri, where, path, g->error));
        const enum kiln_found way =
            g->status == KILN_OK ? kiln_confine_find(g->confine, "", path, found) : KILN_FOUND_NOT;
        if (way == KILN_FOUND_OTHERWISE)
            gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_REPEATED, g->error,
                                           "%s: '%.200s' is not in the scene's folder; '%.200s', which is, is used",
                                           where, path, found));
        if (g->status == KILN_OK)
            gltf_take(g, kiln_confine_map(g->confine, g->builder, way == KILN_FOUND_NOT ? path : found, where,
                                          &buffer->file, g->error));
        buffer->data = buffer->file.data;
        buffer->size = buffer->file.size;
    }
    if (g->status == KILN_OK && length > buffer->size)
        gltf_fail(g, place, "byteLength", "is %llu, but the buffer has only %zu bytes", (unsigned long long)length,
                  buffer->size);
    buffer->size = (size_t)length;
}

static void read_view(struct gltf *g, size_t index)
{
    const struct gltf_place place = {"bufferViews", index, ""};
    const json_t *json = gltf_element(g, "bufferViews", index);
    const uint32_t buffer = gltf_index(g, place, json, "buffer", g->buffer_count);
    if (g->status == KILN_OK && buffer == KILN_NONE)
        gltf_fail(g, place, "buffer", "is missing");
    if (g->status != KILN_OK)
        return;
    const size_t size = g->buffers[buffer].size;
    const uint64_t offset = gltf_whole(g, place, json, "byteOffset", 0, size, 0);
    const uint64_t length = gltf_needed(g, place, json, "byteLength", 1, size);
    struct gltf_view *view = &g->views[index];
    view->stride = (size_t)gltf_whole(g, place, json, "byteStride", 4, 252, 0);
    if (g->status != KILN_OK)
        return;
    if (length > size - offset) {
        gltf_fail(g, place, "byteLength", "is %llu from byte %llu, but buffer %u has %zu bytes",
                  (unsigned long long)length, (unsigned long long)offset, buffer, size);
        return;
    }
    view->data = g->buffers[buffer].data == NULL ? NULL : g->buffers[buffer].data + offset;
    view->size = (size_t)length;
    const json_t *compressed = gltf_extension(g, place, json, "EXT_meshopt_compression");
    if (compressed != NULL)
        gltf_read_meshopt(g, (struct gltf_place){"bufferViews", index, ".extensions.EXT_meshopt_compression"},
                          compressed, view);
}

void gltf_read_buffers(struct gltf *g)
{
    g->buffer_count = gltf_length(g, "buffers");
    g->view_count = gltf_length(g, "bufferViews");
    if (g->status == KILN_OK)
        gltf_take(
            g, kiln_arena_allocate(&g->arena, &g->buffers, g->buffer_count, sizeof *g->buffers, "buffers", g->error));
    if (g->status == KILN_OK)
        gltf_take(g,
                  kiln_arena_allocate(&g->arena, &g->views, g->view_count, sizeof *g->views, "buffer views", g->error));
    for (size_t i = 0; i < g->buffer_count && g->status == KILN_OK; i++)
        read_buffer(g, i);
    for (size_t i = 0; i < g->view_count && g->status == KILN_OK; i++)
        read_view(g, i);
}
