/* The parsed glTF document: typed access to its JSON, its buffers and its accessors. Private to
 * coordinator/import/gltf*.c and to coordinator/export, which writes the document again.
 *
 * Failure is sticky: the first fault that any getter finds is written to `error` and kept in `status`; later calls
 * return harmless defaults and keep the first sentence. Callers check `status` before they act on what they read. */
#ifndef KILN_COORDINATOR_IMPORT_GLTF_DOCUMENT_H
#define KILN_COORDINATOR_IMPORT_GLTF_DOCUMENT_H

#include <jansson.h>

#include "coordinator/import/assemble.h"
#include "coordinator/import/confine.h"
#include "coordinator/import/image.h"
#include "coordinator/import/missing.h"
#include "coordinator/import/names.h"
#include "coordinator/import/numbers.h"
#include "coordinator/import/kinds.h"
#include "worker/base/arena.h"

struct gltf_buffer {
    const unsigned char *data; /* NULL: the buffer has no bytes (a fallback buffer, which nothing may use) */
    size_t size;
    struct kiln_file file; /* an external file, or */
    unsigned char *owned;  /* a decoded data URI */
};

struct gltf_view {
    const unsigned char *data;
    size_t size;
    size_t stride;        /* 0: tightly packed */
    unsigned char *owned; /* decompressed bytes, if any */
    bool counted;         /* its Draco triangles are already in `draco_triangles` */
};

struct gltf_accessor {
    const unsigned char *data; /* NULL: all zeros */
    size_t stride;
    size_t count;
    unsigned component;  /* 5120 .. 5126 */
    unsigned components; /* 1 .. 16 */
    bool normalized;
    size_t sparse_count;
    const unsigned char *sparse_indices, *sparse_values;
    unsigned sparse_component;
};

/* A material's reference to a texture. */
struct gltf_texture_use {
    uint32_t texture; /* index of the glTF texture, or KILN_NONE */
    uint32_t texcoord;
    float transform[6]; /* u' = t[0] u + t[1] v + t[2], v' = t[3] u + t[4] v + t[5] */
};

struct gltf_material {
    /* `base` also serves a transmission texture with the same coordinates, or one that is the only texture */
    struct gltf_texture_use base, emission, normal;
    /* gloss.texcoord is the TEXCOORD set that all gloss textures share; gloss.transform is unused, since each texture
     * has its own. gloss.texture is KILN_NONE if no such set is needed */
    struct gltf_texture_use gloss;
};

#define GLTF_UNREAD 0xfffffffeu /* a mesh that has not been read yet */

struct gltf {
    struct kiln_confine *confine;
    struct kiln_builder *builder;
    struct kiln_error *error;
    int status;
    json_t *root;
    struct kiln_file file;
    const unsigned char *binary; /* GLB chunk, or NULL */
    size_t binary_size;
    struct gltf_buffer *buffers;
    struct gltf_view *views;
    struct gltf_accessor *accessors;
    struct gltf_material *materials; /* one per material of the file; the builder's materials have the same indices */
    struct kiln_images images;
    struct kiln_image *image_of; /* per glTF image: the decoded image, once it is decoded */
    uint8_t *image_state;        /* per glTF image: GLTF_IMAGE_... */
    struct kiln_missing missing; /* missing pictures */
    /* per glTF texture: the builder's texture with sRGB-coded colours, or KILN_NONE; after these, one more entry per
     * glTF texture, for the builder's texture with linear colours */
    uint32_t *texture_of;
    uint8_t *mesh_uses; /* per glTF mesh: flags GLTF_USED... for its use by nodes of the scene */
    uint32_t *mesh_of;  /* per glTF mesh: the builder's mesh, KILN_NONE (no triangles) or GLTF_UNREAD */
    size_t buffer_count, view_count, accessor_count, material_count, image_count, texture_count, mesh_count;
    uint32_t default_material; /* index in the builder, or KILN_NONE until it is needed */
    struct kiln_assembly_counts assembly;
    struct kiln_names names;
    uint64_t draco_triangles; /* triangles that the Draco data may hold, in addition to the limit by file size */
    uint64_t triangles, sparse_elements, objects, expanded;
    /* counts for notes */
    uint64_t points_and_lines, without_material, missing_texcoords, missing_normal_texcoords, missing_gloss_texcoords,
        clamped_colors, without_area_objects, skipped_lights, hard_spots;
    uint64_t unknown_settings;
    uint64_t skins, morphs; /* skinned nodes; morph targets of primitives */
    uint64_t skin_joints, posed_triangles;
    uint64_t outside_nodes, hidden_nodes, strange_cameras;
    struct kiln_kinds unused; /* features of the file that are not used */
    struct kiln_arena arena;
};
enum { GLTF_USED = 1, GLTF_USED_SKINNED = 2 };
/* Flags of an image: its file is missing; the uses that asked for it. */
enum {
    GLTF_IMAGE_MISSING = 1,
    GLTF_IMAGE_FOR_EMISSION = 2,
    GLTF_IMAGE_FOR_METAL = 4,
    GLTF_IMAGE_FOR_NORMALS = 8,
    GLTF_IMAGE_FOR_REST = 16,
    GLTF_IMAGE_PLANNED = 32 /* its texels are counted */
};

/* A place in the document: "meshes[3]" + ".primitives[1]" (`below` may be empty). */
struct gltf_place {
    const char *array;
    size_t index;
    const char *below;
};

/* Fails with "FILE: PLACE.KEY <text>; repair the file or export it again" (KILN_BAD_INPUT), unless something failed
 * before. */
void gltf_fail(struct gltf *g, struct gltf_place place, const char *key, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
/* Records the status of a call that has already written its sentence. */
void gltf_take(struct gltf *g, int status);

/* A member of the given type; NULL if absent or, which is a failure, of another type. */
json_t *gltf_object(struct gltf *g, struct gltf_place place, const json_t *object, const char *key);
json_t *gltf_array(struct gltf *g, struct gltf_place place, const json_t *object, const char *key);
const char *gltf_string(struct gltf *g, struct gltf_place place, const json_t *object, const char *key);
bool gltf_bool(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, bool absent);
/* A whole number in [low, high]; `absent` if there is none. */
uint64_t gltf_whole(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, uint64_t low,
                    uint64_t high, uint64_t absent);
/* The same, but required. */
uint64_t gltf_needed(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, uint64_t low,
                     uint64_t high);
/* An index below `limit`; KILN_NONE if absent. */
uint32_t gltf_index(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, size_t limit);
/* A number in the range of `number`; `absent` if there is none. */
double gltf_number(struct gltf *g, struct gltf_place place, const json_t *object, enum kiln_number number,
                   double absent);
/* Exactly `count` numbers in that range; returns false, with values unchanged, if absent or failed. */
bool gltf_numbers(struct gltf *g, struct gltf_place place, const json_t *object, enum kiln_number number, size_t count,
                  double *values);
/* The member object.extensions.NAME, or NULL. */
json_t *gltf_extension(struct gltf *g, struct gltf_place place, const json_t *object, const char *name);
/* Element `index` of a top-level array, checked to be an object; NULL on failure. */
json_t *gltf_element(struct gltf *g, const char *array, size_t index);
size_t gltf_length(struct gltf *g, const char *array);

/* gltf_buffer.c: container, buffers, buffer views. */
void gltf_open(struct gltf *g);
void gltf_read_buffers(struct gltf *g);
/* Decodes a "data:" URI into *bytes (from kiln_allocate). */
void gltf_decode_data(struct gltf *g, struct gltf_place place, const char *uri, unsigned char **bytes, size_t *size);

/* gltf_meshopt.c: decodes EXT_meshopt_compression into view->owned, and sets the view's data and size. */
void gltf_read_meshopt(struct gltf *g, struct gltf_place place, const json_t *extension, struct gltf_view *view);

/* gltf_draco.c: decodes KHR_draco_mesh_compression. `uses` has copies of a primitive's accessors, named by attribute
 * (count 0: not used). The copies are redirected to decompressed values; copies that the extension does not name stay
 * unchanged. Free the values with gltf_draco_values_free, also after a failure. */
enum { GLTF_DRACO_ATTRIBUTES = 12 };
struct gltf_draco_use {
    const char *name; /* "POSITION" */
    struct gltf_accessor *accessor;
};
struct gltf_draco_values {
    uint32_t *indices;
    float *attributes[GLTF_DRACO_ATTRIBUTES];
};
void gltf_read_draco(struct gltf *g, struct gltf_place place, const json_t *primitive, struct gltf_draco_use *uses,
                     size_t use_count, struct gltf_accessor *indices, struct gltf_draco_values *values);
void gltf_draco_values_free(struct gltf_draco_values *values);

/* gltf_accessor.c */
void gltf_read_accessors(struct gltf *g);
/* Gets element `index` (below count) as floats, up to 4 components; values of missing components stay unchanged.
 * Integers are normalised if the accessor says so. */
void gltf_accessor_float(const struct gltf_accessor *accessor, size_t index, float *values);
uint32_t gltf_accessor_index(const struct gltf_accessor *accessor, size_t index);
/* The bytes of element `index` (not of a matrix), components one after the other; NULL: zeros. */
const unsigned char *gltf_accessor_element(const struct gltf_accessor *accessor, size_t index);
size_t gltf_component_size(unsigned component);
/* Component `c` of element `index` as stored, not normalised. */
double gltf_accessor_raw(const struct gltf_accessor *accessor, size_t index, unsigned c);

/* gltf_material.c */
void gltf_read_materials(struct gltf *g);
uint32_t gltf_default_material(struct gltf *g);
/* Reads a textureInfo; use->texture stays KILN_NONE if it is absent. */
void gltf_texture_info(struct gltf *g, struct gltf_place place, const json_t *parent, const char *key,
                       struct gltf_texture_use *use);
/* The index of a glTF texture's image; fails if it has none that kiln reads. */
uint32_t gltf_source_image(struct gltf *g, uint32_t texture);
/* The builder's texture for a glTF texture, made on first use; KILN_NONE if its picture is missing. `srgb`: its colours
 * are coded in sRGB; else they are linear. */
uint32_t gltf_builder_texture(struct gltf *g, uint32_t texture, bool srgb);
/* Mean of the coded values of one channel of a glTF texture's image, 0..1; 1 if the image is missing. */
double gltf_image_mean(struct gltf *g, uint32_t texture, unsigned channel);
/* Whether the picture of a glTF texture is missing; `use` (GLTF_IMAGE_FOR_...) is the use that asks for it. */
bool gltf_texture_is_missing(struct gltf *g, uint32_t texture, unsigned use);
/* The builder's texture for an optional texture of directions. If its picture is missing, broken or no normal map,
 * returns KILN_NONE and adds a note that begins with `what` ("normalTexture") and ends with `without`. */
uint32_t gltf_directions_texture(struct gltf *g, struct gltf_place place, uint32_t texture, const char *what,
                                 const char *without);
/* The material's KHR_materials_pbrSpecularGlossiness, unless it is unlit; NULL: none. */
const json_t *gltf_specular_glossiness(struct gltf *g, struct gltf_place place, const json_t *material);

/* gltf_gloss.c: reads the non-diffuse properties of a material, and appends a struct kiln_gloss if they differ from the
 * defaults. `material` is the builder's material `index`; sets the gloss of g->materials[place.index]. *gloss receives
 * the properties, defaults included. */
void gltf_read_gloss(struct gltf *g, struct gltf_place place, const json_t *json, const struct kiln_material *material,
                     uint32_t index, struct kiln_gloss *gloss);

/* gltf_mesh.c: the corners of triangle k of a primitive (mode 4, 5 or 6; `indices` may be NULL), counter-clockwise seen
 * from the front. */
void gltf_triangle(unsigned mode, const struct gltf_accessor *indices, size_t k, uint32_t corner[3]);

/* The builder's mesh for a glTF mesh in a pose; KILN_NONE if it has no triangles. Nodes with the mesh's common pose
 * share one mesh, which is made on first use. A node with a pose of its own (gltf_pose_is_own) gets a new one. */
struct gltf_pose;
uint32_t gltf_mesh(struct gltf *g, uint32_t index, const struct gltf_pose *pose);
/* The accessor of an attribute; NULL: absent. Fails unless its elements have `low` to `high` components and, if `count`
 * is not 0, there are `count` elements. */
const struct gltf_accessor *gltf_attribute(struct gltf *g, struct gltf_place place, const json_t *attributes,
                                           const char *name, unsigned low, unsigned high, size_t count);

/* gltf.c: checks that kiln can read asset.version and extensionsRequired. */
void gltf_check(struct gltf *g);
/* Releases the document and unmaps its files. */
void gltf_close(struct gltf *g);

/* gltf_unused.c: adds notes on features of the document that no bake uses. Call it after gltf_read_scene. */
void gltf_note_unused(struct gltf *g);

/* gltf_node.c: node tree, objects, lights, cameras, environment. */
void gltf_read_scene(struct gltf *g);

/* gltf_lod.c: reads the file's levels of detail (lods.h) into the settings of the builder's objects. Call it after
 * gltf_read_scene. */
void gltf_read_lods(struct gltf *g);

#endif
