/* Scene builder: a scene under construction, as growing arrays with the element types of worker/scene/scene.h. Readers
 * (gltf.c, obj.c) append elements. coordinator/layout adds lightmap layouts and sizes. kiln_builder_write checks the
 * scene and writes the scene file. */
#ifndef KILN_COORDINATOR_SCENE_BUILDER_H
#define KILN_COORDINATOR_SCENE_BUILDER_H

#include <stdbool.h>

#include "coordinator/job/object_settings.h"
#include "worker/scene/scene.h"

/* The second UV set of a mesh in its file: there is none; there is one; it is known to be valid, without a flaw. */
enum { KILN_LIGHTMAP_UV_NONE = 0, KILN_LIGHTMAP_UV_GIVEN, KILN_LIGHTMAP_UV_SOUND };

struct kiln_builder {
    struct {
        void *data;
        size_t count, capacity; /* in elements of kiln_scene_element_size(section) bytes */
    } sections[KILN_SECTION_COUNT];
    /* Per mesh: KILN_LIGHTMAP_UV_NONE, ... Without a second UV set, the TEXCOORD_LIGHTMAP of its vertices is zero
     * until the layout is made. */
    uint8_t *mesh_has_lightmap_uv;
    size_t mesh_capacity;
    uint64_t *mesh_turned; /* per mesh: number of triangles whose normals point to the back of their winding */
    size_t turned_capacity;
    bool trust_normals; /* flips the winding of such triangles; false: reverses their normals */
    bool up_z;          /* an OBJ file's z points up, not its y */
    double unit;        /* m, of an OBJ file; 0: 1 m */
    bool strict;        /* missing pictures are an error */
    /* per object: the user's settings */
    struct kiln_object_settings *object_settings;
    size_t object_capacity;
    uint64_t import_hash[2];
    float texels_per_metre, padding_factor; /* for the scene file's header */
    uint32_t units;                         /* enum kiln_scene_units */
    bool part;                              /* written as the scene file of a part, before layouts are made */
};

/* Largest absolute value of a coordinate, m, in a mesh and in the world: products of three stay within float. */
#define KILN_COORDINATE_MAX 1e12f

#define KILN_BUILDER_DATA(builder, type, section) ((type *)(builder)->sections[section].data)

int kiln_builder_create(struct kiln_builder **builder, struct kiln_error *error);
void kiln_builder_destroy(struct kiln_builder **builder);
/* Appends `count` elements (copied from `data`; zeroed if data is NULL). Gives the index of the first. */
int kiln_builder_append(struct kiln_builder *builder, enum kiln_scene_section section, const void *data, size_t count,
                        size_t *first, struct kiln_error *error);
/* Reserves memory for `count` elements of an empty section, so that it is not reallocated up to that size. */
int kiln_builder_reserve(struct kiln_builder *builder, enum kiln_scene_section section, size_t count,
                         struct kiln_error *error);
/* Tells whether the scene has this vertex section: normal-map coordinates only if it has normal maps, gloss coordinates
 * only if it has gloss, all others always. Materials must have been appended before. */
bool kiln_builder_has(const struct kiln_builder *builder, enum kiln_scene_section section);
/* Appends a string (at most `length` bytes). Gives its offset. */
int kiln_builder_string(struct kiln_builder *builder, const char *text, size_t length, uint32_t *offset,
                        struct kiln_error *error);
/* Adds a note; `severity` is an enum kiln_note_severity. */
int kiln_builder_note(struct kiln_builder *builder, uint32_t severity, struct kiln_error *error, const char *format,
                      ...) __attribute__((format(printf, 4, 5)));
/* Makes the builder one of a part, whose scene file keeps what layouts need later (KILN_SCENE_VERSION_PART): flags of
 * meshes, and settings of objects. Call it when the file is read, before the builder is written. */
int kiln_builder_make_part(struct kiln_builder *builder, struct kiln_error *error);
/* Computes centre, bounds and hashes and writes the file to `path` (created, synced; the caller renames it). Empties
 * the builder's sections as it writes them, so that a scene with many texels is in memory once, not twice.
 * KILN_BAD_INPUT when an object extends beyond KILN_COORDINATE_MAX. */
int kiln_builder_write(struct kiln_builder *builder, const char *path, struct kiln_error *error);
/* Writes like kiln_builder_write, but to an open, empty file (O_RDWR), which stays open. `name` is for messages. */
int kiln_builder_write_to(struct kiln_builder *builder, int file, const char *name, struct kiln_error *error);

#endif
