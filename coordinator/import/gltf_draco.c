/* KHR_draco_mesh_compression: decodes the indices and attributes of a primitive from one compressed buffer view. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/import/draco_decode.h"
#include "coordinator/import/gltf_document.h"
#include "worker/base/memory.h"

enum { FLOAT = 5126, UNSIGNED_INT = 5125 };

/* Upper bound, with a margin, for the triangles that one byte encodes: Edgebreaker connectivity takes one or two bits
 * per triangle. */
static const uint64_t triangles_per_byte = 64;

static struct kiln_draco *decode(struct gltf *g, struct gltf_place place, const json_t *extension)
{
    char reason[200] = "";
    const uint32_t index = gltf_index(g, place, extension, "bufferView", g->view_count);
    if (g->status == KILN_OK && index == KILN_NONE)
        gltf_fail(g, place, "extensions.KHR_draco_mesh_compression.bufferView", "is missing");
    if (g->status != KILN_OK)
        return NULL;
    struct gltf_view *view = &g->views[index];
    if (view->data == NULL) {
        gltf_fail(g, place, "extensions.KHR_draco_mesh_compression.bufferView", "%u has no bytes", index);
        return NULL;
    }
    struct kiln_draco *draco = kiln_draco_decode(view->data, view->size, reason, sizeof reason);
    if (draco == NULL)
        gltf_fail(g, place, "extensions.KHR_draco_mesh_compression",
                  "cannot be decoded from buffer view %u of %zu bytes (%s)", index, view->size, reason);
    if (!view->counted)
        g->draco_triangles += triangles_per_byte * view->size;
    view->counted = true;
    return draco;
}

/* Points an accessor that has a count and a type, but no bytes, to decoded values. */
static void attach(struct gltf_accessor *accessor, void *values, unsigned component)
{
    accessor->data = values;
    accessor->component = component;
    accessor->normalized = false;
    accessor->stride = 4 * accessor->components;
    accessor->sparse_count = 0;
}

static void read_indices(struct gltf *g, struct gltf_place place, const struct kiln_draco *draco,
                         struct gltf_accessor *accessor, struct gltf_draco_values *values)
{
    const size_t corners = 3 * kiln_draco_triangle_count(draco);
    if (accessor->count != corners) {
        gltf_fail(g, place, "indices", "has %zu elements, but its compressed data has %zu", accessor->count, corners);
        return;
    }
    gltf_take(g, kiln_allocate(&values->indices, corners, sizeof *values->indices, "compressed indices", g->error));
    if (g->status != KILN_OK)
        return;
    kiln_draco_corners(draco, values->indices);
    attach(accessor, values->indices, UNSIGNED_INT);
}

/* The largest value of a normalised component type. */
static float largest_of(unsigned component)
{
    static const float largest[] = {127.0f, 255.0f, 32767.0f, 65535.0f};
    return component >= 5120 && component <= 5123 ? largest[component - 5120] : 1.0f;
}

static void read_attribute(struct gltf *g, struct gltf_place place, const struct kiln_draco *draco, const char *name,
                           uint32_t id, struct gltf_accessor *accessor, float **values)
{
    const size_t count = accessor->count * accessor->components;
    if (accessor->count != kiln_draco_vertex_count(draco)) {
        gltf_fail(g, place, name, "has %zu elements, but its compressed data has %zu", accessor->count,
                  kiln_draco_vertex_count(draco));
        return;
    }
    gltf_take(g, kiln_allocate(values, count, sizeof **values, "a compressed attribute", g->error));
    if (g->status != KILN_OK)
        return;
    if (!kiln_draco_attribute(draco, id, accessor->components, *values)) {
        gltf_fail(g, place, name, "is attribute %u of the compressed data, which has none like this with %u components",
                  id, accessor->components);
        return;
    }
    for (size_t i = 0; accessor->normalized && i < count; i++)
        (*values)[i] = fmaxf((*values)[i] / largest_of(accessor->component), -1.0f);
    attach(accessor, *values, FLOAT);
}

void gltf_read_draco(struct gltf *g, struct gltf_place place, const json_t *primitive, struct gltf_draco_use *uses,
                     size_t use_count, struct gltf_accessor *indices, struct gltf_draco_values *values)
{
    const json_t *extension = gltf_extension(g, place, primitive, "KHR_draco_mesh_compression");
    const json_t *attributes = gltf_object(g, place, extension, "attributes");
    if (g->status == KILN_OK && (attributes == NULL || indices->count == 0))
        gltf_fail(g, place, "extensions.KHR_draco_mesh_compression",
                  "lacks its attributes, or the primitive its indices");
    struct kiln_draco *draco = g->status == KILN_OK ? decode(g, place, extension) : NULL;
    if (draco != NULL)
        read_indices(g, place, draco, indices, values);
    for (size_t i = 0; i < use_count && g->status == KILN_OK; i++) {
        /* an attribute that is not compressed is read from its accessor as usual */
        const uint32_t id = gltf_index(g, place, attributes, uses[i].name, UINT32_MAX);
        if (id != KILN_NONE && uses[i].accessor->count > 0 && g->status == KILN_OK)
            read_attribute(g, place, draco, uses[i].name, id, uses[i].accessor, &values->attributes[i]);
    }
    kiln_draco_destroy(&draco);
}

void gltf_draco_values_free(struct gltf_draco_values *values)
{
    kiln_free(&values->indices);
    for (size_t i = 0; i < GLTF_DRACO_ATTRIBUTES; i++)
        kiln_free(&values->attributes[i]);
}
