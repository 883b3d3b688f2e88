/* Accessors: checked once, then read in place. */
#include <string.h>

#include "coordinator/import/gltf_document.h"
#include "worker/base/arena.h"

enum { BYTE = 5120, UNSIGNED_BYTE = 5121, SHORT = 5122, UNSIGNED_SHORT = 5123, UNSIGNED_INT = 5125, FLOAT = 5126 };

size_t gltf_component_size(unsigned component)
{
    switch (component) {
    case BYTE:
    case UNSIGNED_BYTE:
        return 1;
    case SHORT:
    case UNSIGNED_SHORT:
        return 2;
    case UNSIGNED_INT:
    case FLOAT:
        return 4;
    default:
        return 0;
    }
}

static unsigned component_count(const char *type)
{
    static const struct {
        const char *name;
        unsigned count;
    } types[] = {{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}, {"MAT2", 4}, {"MAT3", 9}, {"MAT4", 16}};
    for (size_t i = 0; type != NULL && i < sizeof types / sizeof types[0]; i++)
        if (strcmp(type, types[i].name) == 0)
            return types[i].count;
    return 0;
}

/* Returns the size of an element, bytes. Matrix columns are aligned to four bytes. */
static size_t element_size(const char *type, unsigned component, unsigned components)
{
    const size_t size = gltf_component_size(component);
    if (strncmp(type, "MAT", 3) != 0)
        return size * components;
    const size_t side = components == 4 ? 2 : components == 9 ? 3 : 4;
    return side * ((side * size + 3) / 4 * 4);
}

/* Checks that `count` elements of `size` bytes, every `stride` bytes from `offset`, lie within the view. Returns the
 * address of the first. */
static const unsigned char *checked_range(struct gltf *g, struct gltf_place place, uint32_t view_index, uint64_t offset,
                                          size_t count, size_t size, size_t stride)
{
    const struct gltf_view *view = &g->views[view_index];
    if (view->data == NULL) {
        gltf_fail(g, place, "bufferView", "%u has no bytes of its own: it is compressed", view_index);
        return NULL;
    }
    if (offset > view->size || count > 0) {
        const uint64_t room = offset > view->size ? 0 : view->size - offset;
        if (room < size || (count - 1) > (room - size) / stride) {
            gltf_fail(g, place, "count",
                      "is %zu, but buffer view %u of %zu bytes holds fewer elements of %zu bytes from byte %llu", count,
                      view_index, view->size, size, (unsigned long long)offset);
            return NULL;
        }
    }
    return view->data + offset;
}

static void check_sparse_order(struct gltf *g, struct gltf_place place, const struct gltf_accessor *accessor)
{
    const struct gltf_accessor indices = {.data = accessor->sparse_indices,
                                          .stride = gltf_component_size(accessor->sparse_component),
                                          .count = accessor->sparse_count,
                                          .component = accessor->sparse_component,
                                          .components = 1};
    uint64_t next = 0;
    for (size_t i = 0; i < accessor->sparse_count; i++) {
        const uint32_t index = gltf_accessor_index(&indices, i);
        if (index < next || index >= accessor->count) {
            gltf_fail(g, place, "sparse.indices", "element %zu is %u: not ascending or not below the count of %zu", i,
                      index, accessor->count);
            return;
        }
        next = (uint64_t)index + 1;
    }
}

static void read_sparse(struct gltf *g, struct gltf_place place, const json_t *sparse, struct gltf_accessor *accessor,
                        size_t size)
{
    const json_t *indices = gltf_object(g, place, sparse, "indices"), *values = gltf_object(g, place, sparse, "values");
    const size_t count = (size_t)gltf_needed(g, place, sparse, "count", 1, accessor->count);
    if (g->status == KILN_OK && (indices == NULL || values == NULL))
        gltf_fail(g, place, "sparse", "lacks its indices or values");
    const uint32_t index_view = gltf_index(g, place, indices, "bufferView", g->view_count);
    const uint32_t value_view = gltf_index(g, place, values, "bufferView", g->view_count);
    if (g->status == KILN_OK && (index_view == KILN_NONE || value_view == KILN_NONE))
        gltf_fail(g, place, "sparse", "lacks a buffer view");
    accessor->sparse_component = (unsigned)gltf_needed(g, place, indices, "componentType", UNSIGNED_BYTE, UNSIGNED_INT);
    if (g->status == KILN_OK && accessor->sparse_component != UNSIGNED_BYTE &&
        accessor->sparse_component != UNSIGNED_SHORT && accessor->sparse_component != UNSIGNED_INT)
        gltf_fail(g, place, "sparse.indices.componentType", "is %u, not one of 5121, 5123, 5125",
                  accessor->sparse_component);
    const uint64_t index_offset = gltf_whole(g, place, indices, "byteOffset", 0, UINT64_MAX >> 12, 0);
    const uint64_t value_offset = gltf_whole(g, place, values, "byteOffset", 0, UINT64_MAX >> 12, 0);
    if (g->status != KILN_OK)
        return;
    g->sparse_elements += count;
    if (g->sparse_elements > 65536 + g->confine->total_bytes) {
        gltf_fail(g, place, "sparse.count", "brings the file to %llu sparse elements, more than its bytes can hold",
                  (unsigned long long)g->sparse_elements);
        return;
    }
    const size_t index_size = gltf_component_size(accessor->sparse_component);
    accessor->sparse_indices = checked_range(g, place, index_view, index_offset, count, index_size, index_size);
    accessor->sparse_values = checked_range(g, place, value_view, value_offset, count, size, size);
    accessor->sparse_count = count;
    if (g->status == KILN_OK)
        check_sparse_order(g, place, accessor);
}

static void read_accessor(struct gltf *g, size_t index)
{
    const struct gltf_place place = {"accessors", index, ""};
    const json_t *json = gltf_element(g, "accessors", index);
    struct gltf_accessor *accessor = &g->accessors[index];
    const char *type = gltf_string(g, place, json, "type");
    accessor->component = (unsigned)gltf_needed(g, place, json, "componentType", 0, 65535);
    accessor->components = component_count(type);
    if (g->status == KILN_OK && gltf_component_size(accessor->component) == 0)
        gltf_fail(g, place, "componentType", "is %u, not one of 5120 to 5123, 5125, 5126", accessor->component);
    if (g->status == KILN_OK && accessor->components == 0)
        gltf_fail(g, place, "type", "is '%.20s', which glTF does not know", type == NULL ? "" : type);
    /* at most 2^32 - 2, so that no element has the index KILN_NONE */
    accessor->count = (size_t)gltf_needed(g, place, json, "count", 1, UINT32_MAX - 1);
    accessor->normalized = gltf_bool(g, place, json, "normalized", false);
    const uint32_t view = gltf_index(g, place, json, "bufferView", g->view_count);
    const uint64_t offset = gltf_whole(g, place, json, "byteOffset", 0, UINT64_MAX >> 12, 0);
    const json_t *sparse = gltf_object(g, place, json, "sparse");
    if (g->status != KILN_OK)
        return;
    if (accessor->normalized && (accessor->component == FLOAT || accessor->component == UNSIGNED_INT)) {
        gltf_fail(g, place, "normalized", "is true for a component type that cannot be");
        return;
    }
    const size_t size = element_size(type, accessor->component, accessor->components);
    accessor->stride = size;
    if (view != KILN_NONE) {
        if (g->views[view].stride != 0)
            accessor->stride = g->views[view].stride;
        if (accessor->stride < size)
            gltf_fail(g, place, "bufferView", "%u has a stride of %zu for elements of %zu bytes", view,
                      accessor->stride, size);
        if (g->status == KILN_OK)
            accessor->data = checked_range(g, place, view, offset, accessor->count, size, accessor->stride);
    }
    if (sparse != NULL && g->status == KILN_OK)
        read_sparse(g, place, sparse, accessor, size);
}

void gltf_read_accessors(struct gltf *g)
{
    g->accessor_count = gltf_length(g, "accessors");
    if (g->status == KILN_OK)
        gltf_take(g, kiln_arena_allocate(&g->arena, &g->accessors, g->accessor_count, sizeof *g->accessors, "accessors",
                                         g->error));
    for (size_t i = 0; i < g->accessor_count && g->status == KILN_OK; i++)
        read_accessor(g, i);
}

static float component_value(const unsigned char *at, unsigned component, bool normalized)
{
    switch (component) {
    case BYTE: {
        int8_t value;
        memcpy(&value, at, sizeof value);
        return normalized ? fmaxf((float)value / 127.0f, -1.0f) : (float)value;
    }
    case UNSIGNED_BYTE:
        return normalized ? (float)*at / 255.0f : (float)*at;
    case SHORT: {
        int16_t value;
        memcpy(&value, at, sizeof value);
        return normalized ? fmaxf((float)value / 32767.0f, -1.0f) : (float)value;
    }
    case UNSIGNED_SHORT: {
        uint16_t value;
        memcpy(&value, at, sizeof value);
        return normalized ? (float)value / 65535.0f : (float)value;
    }
    case UNSIGNED_INT: {
        uint32_t value;
        memcpy(&value, at, sizeof value);
        return (float)value;
    }
    default: {
        float value;
        memcpy(&value, at, sizeof value);
        return value;
    }
    }
}

/* The address of element `index`: among the sparse values if it is one of them (found by bisection), else in the
 * view. */
const unsigned char *gltf_accessor_element(const struct gltf_accessor *accessor, size_t index)
{
    if (accessor->sparse_count > 0) {
        const struct gltf_accessor indices = {.data = accessor->sparse_indices,
                                              .stride = gltf_component_size(accessor->sparse_component),
                                              .count = accessor->sparse_count,
                                              .component = accessor->sparse_component,
                                              .components = 1};
        size_t low = 0, high = accessor->sparse_count;
        while (low < high) {
            const size_t middle = low + (high - low) / 2;
            if (gltf_accessor_index(&indices, middle) < index)
                low = middle + 1;
            else
                high = middle;
        }
        if (low < accessor->sparse_count && gltf_accessor_index(&indices, low) == index)
            return accessor->sparse_values + low * gltf_component_size(accessor->component) * accessor->components;
    }
    return accessor->data == NULL ? NULL : accessor->data + index * accessor->stride;
}

void gltf_accessor_float(const struct gltf_accessor *accessor, size_t index, float *values)
{
    const unsigned char *at = gltf_accessor_element(accessor, index);
    const unsigned count = accessor->components < 4 ? accessor->components : 4;
    const size_t size = gltf_component_size(accessor->component);
    for (unsigned c = 0; c < count; c++)
        values[c] = at == NULL ? 0.0f : component_value(at + c * size, accessor->component, accessor->normalized);
}

uint32_t gltf_accessor_index(const struct gltf_accessor *accessor, size_t index)
{
    const unsigned char *at = gltf_accessor_element(accessor, index);
    if (at == NULL)
        return 0;
    switch (accessor->component) {
    case UNSIGNED_BYTE:
        return *at;
    case UNSIGNED_SHORT: {
        uint16_t value;
        memcpy(&value, at, sizeof value);
        return value;
    }
    default: {
        uint32_t value;
        memcpy(&value, at, sizeof value);
        return value;
    }
    }
}

double gltf_accessor_raw(const struct gltf_accessor *accessor, size_t index, unsigned c)
{
    const unsigned char *at = gltf_accessor_element(accessor, index);
    if (at == NULL)
        return 0.0;
    at += c * gltf_component_size(accessor->component);
    if (accessor->component == UNSIGNED_INT) {
        uint32_t value;
        memcpy(&value, at, sizeof value);
        return (double)value;
    }
    return (double)component_value(at, accessor->component, false);
}
