/* EXT_meshopt_compression: decompresses and filters buffer views before anything reads them. */
#include <meshoptimizer.h>
#include <string.h>

#include "coordinator/import/gltf_document.h"
#include "worker/base/memory.h"

/* Upper bound, with a margin, for the bytes that one compressed byte becomes. The codecs omit repetitions: attributes
 * reach 64 (two bits for 16 equal bytes), triangles 12. */
static const uint64_t expansion = 256;

enum mode { ATTRIBUTES, TRIANGLES, INDICES };
enum filter { NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL };

struct compressed {
    const unsigned char *data;
    size_t size, stride, count;
    enum mode mode;
    enum filter filter;
};

/* The index of a word in a list; `count`, and a failure, if it is not there. */
static unsigned read_word(struct gltf *g, struct gltf_place place, const json_t *json, const char *key,
                          const char *const *words, unsigned count, unsigned absent)
{
    const char *text = gltf_string(g, place, json, key);
    for (unsigned i = 0; text != NULL && i < count; i++)
        if (strcmp(text, words[i]) == 0)
            return i;
    if (g->status == KILN_OK && (text != NULL || absent == count))
        gltf_fail(g, place, key, text == NULL ? "is missing%s" : "is '%.20s', which the extension does not have",
                  text == NULL ? "" : text);
    return absent;
}

/* Whether the codecs accept stride and count; the library itself only asserts it. */
static bool fits(const struct compressed *c)
{
    const bool filtered = c->filter == NONE || c->mode == ATTRIBUTES;
    switch (c->mode) {
    case ATTRIBUTES:
        return c->stride % 4 == 0 && c->stride >= 4 && c->stride <= 256 &&
               (c->filter != OCTAHEDRAL || c->stride == 4 || c->stride == 8) &&
               (c->filter != QUATERNION || c->stride == 8);
    case TRIANGLES:
        return filtered && (c->stride == 2 || c->stride == 4) && c->count % 3 == 0;
    default:
        return filtered && (c->stride == 2 || c->stride == 4);
    }
}

static void read_extension(struct gltf *g, struct gltf_place place, const json_t *json, struct compressed *c)
{
    static const char *const modes[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
    static const char *const filters[] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"};
    const uint32_t buffer = gltf_index(g, place, json, "buffer", g->buffer_count);
    if (g->status == KILN_OK && (buffer == KILN_NONE || g->buffers[buffer].data == NULL))
        gltf_fail(g, place, "buffer", buffer == KILN_NONE ? "is missing" : "has no bytes");
    if (g->status != KILN_OK)
        return;
    const size_t room = g->buffers[buffer].size;
    const uint64_t offset = gltf_whole(g, place, json, "byteOffset", 0, room, 0);
    c->size = (size_t)gltf_needed(g, place, json, "byteLength", 1, room);
    c->stride = (size_t)gltf_needed(g, place, json, "byteStride", 1, 256);
    c->count = (size_t)gltf_needed(g, place, json, "count", 1, UINT32_MAX - 1);
    c->mode = (enum mode)read_word(g, place, json, "mode", modes, 3, 3);
    c->filter = (enum filter)read_word(g, place, json, "filter", filters, 4, NONE);
    if (g->status != KILN_OK)
        return;
    if (c->size > room - offset)
        gltf_fail(g, place, "byteLength", "is %zu from byte %llu, but buffer %u has %zu bytes", c->size,
                  (unsigned long long)offset, buffer, room);
    else if (!fits(c))
        gltf_fail(g, place, "byteStride", "is %zu with %zu elements, which its mode and filter do not have", c->stride,
                  c->count);
    else if (c->count * c->stride > 65536 + expansion * c->size)
        gltf_fail(g, place, "count", "is %zu elements of %zu bytes, more than %zu bytes can hold", c->count, c->stride,
                  c->size);
    c->data = g->buffers[buffer].data + offset;
}

static bool decode(const struct compressed *c, unsigned char *bytes)
{
    switch (c->mode) {
    case ATTRIBUTES:
        if (meshopt_decodeVertexBuffer(bytes, c->count, c->stride, c->data, c->size) != 0)
            return false;
        break;
    case TRIANGLES:
        return meshopt_decodeIndexBuffer(bytes, c->count, c->stride, c->data, c->size) == 0;
    case INDICES:
        return meshopt_decodeIndexSequence(bytes, c->count, c->stride, c->data, c->size) == 0;
    }
    if (c->filter == OCTAHEDRAL)
        meshopt_decodeFilterOct(bytes, c->count, c->stride);
    else if (c->filter == QUATERNION)
        meshopt_decodeFilterQuat(bytes, c->count, c->stride);
    else if (c->filter == EXPONENTIAL)
        meshopt_decodeFilterExp(bytes, c->count, c->stride);
    return true;
}

void gltf_read_meshopt(struct gltf *g, struct gltf_place place, const json_t *extension, struct gltf_view *view)
{
    struct compressed c = {.mode = ATTRIBUTES};
    read_extension(g, place, extension, &c);
    if (g->status == KILN_OK && c.count * c.stride < view->size)
        gltf_fail(g, place, "count", "is %zu elements of %zu bytes, fewer than the view's %zu bytes", c.count, c.stride,
                  view->size);
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&view->owned, c.count * c.stride, 1, "a compressed buffer view", g->error));
    if (g->status == KILN_OK && !decode(&c, view->owned))
        gltf_fail(g, place, "", "cannot be decompressed: its %zu bytes are damaged or cut off", c.size);
    view->data = view->owned;
}
