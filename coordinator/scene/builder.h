/* The scene while it is being put together: growing arrays with the element types of worker/scene/scene.h. Readers
 * (gltf.c, obj.c) append, coordinator/layout adds lightmap layouts and sizes, kiln_builder_write checks and writes the
 * scene file. */
#ifndef KILN_COORDINATOR_SCENE_BUILDER_H
#define KILN_COORDINATOR_SCENE_BUILDER_H

#include <stdbool.h>

#include "coordinator/job/object_settings.h"
#include "worker/scene/scene.h"

struct kiln_builder {
    struct {
        void *data;
        size_t count, capacity; /* elements of kiln_scene_element_size(section) bytes */
    } sections[KILN_SECTION_COUNT];
    /* What a mesh's file said of its second UV set: 1 present, 0 absent; one a mesh, grown with the meshes. Where it is
     * absent the TEXCOORD_LIGHTMAP of its vertices is zero until the layout is made. */
    uint8_t *mesh_has_lightmap_uv;
    size_t mesh_capacity;
    uint64_t *mesh_turned; /* a mesh's triangles whose normals lie against their winding; grown with the meshes */
    size_t turned_capacity;
    bool trust_normals; /* such a triangle is turned round; else its normals are */
    /* what the user says of an object; one an object, grown with the objects */
    struct kiln_object_settings *object_settings;
    size_t object_capacity;
    uint64_t import_hash[2];
    float texels_per_metre, padding_factor; /* of the header */
    uint32_t units;                         /* enum kiln_scene_units */
};

/* Largest size of a coordinate, m, in a mesh and in the world: products of three stay within float. */
#define KILN_COORDINATE_MAX 1e12f

#define KILN_BUILDER_DATA(builder, type, section) ((type *)(builder)->sections[section].data)

int kiln_builder_create(struct kiln_builder **builder, struct kiln_error *error);
void kiln_builder_destroy(struct kiln_builder **builder);
/* Appends `count` elements (copied from `data`, zeroed when data is NULL) and gives the index of the first. */
int kiln_builder_append(struct kiln_builder *builder, enum kiln_scene_section section, const void *data, size_t count,
                        size_t *first, struct kiln_error *error);
/* Adds a string (at most `length` bytes) and gives its offset. */
int kiln_builder_string(struct kiln_builder *builder, const char *text, size_t length, uint32_t *offset,
                        struct kiln_error *error);
/* Adds a note of a severity as in struct kiln_note. */
int kiln_builder_note(struct kiln_builder *builder, uint32_t severity, struct kiln_error *error, const char *format,
                      ...) __attribute__((format(printf, 4, 5)));
/* Computes centre, bounds and hashes and writes the file to `path` (new, synced; the caller renames). The builder's
 * sections are empty afterwards: a scene of many texels stands in memory once, not twice. KILN_BAD_INPUT when an object
 * reaches beyond KILN_COORDINATE_MAX. */
int kiln_builder_write(struct kiln_builder *builder, const char *path, struct kiln_error *error);
/* The same into an open, empty file (O_RDWR), which stays open; `name` is for sentences. */
int kiln_builder_write_to(struct kiln_builder *builder, int file, const char *name, struct kiln_error *error);

#endif
