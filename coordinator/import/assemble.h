/* Assembles kiln's vertices and triangles from a file's triangle corners: the step that all readers share, after
 * parsing their format.
 *
 * The rules, the same for all formats: - The winding decides the front face (counter-clockwise). If the normals of a
 * triangle's corners point to the other
 *   side, they are reversed or, with builder->trust_normals, the triangle is flipped. A single corner normal that still
 *   points to the back is replaced by the geometric normal.
 * - A missing or zero normal becomes the geometric one. A primitive whose normals are all zero is refused. - A triangle
 * without area (2 A <= 1e-12 x longest edge squared) is left out and counted. - Only vertices that a kept triangle uses
 * are stored. Corners share a vertex if they come from the same vertex of the
 *   file and have the same normal.
 * - KILN_MESH_SMOOTH is set if some normal differs from the geometric one by more than 1e-3. - Coordinates are finite,
 * and at most KILN_COORDINATE_MAX in absolute value. */
#ifndef KILN_COORDINATOR_IMPORT_ASSEMBLE_H
#define KILN_COORDINATOR_IMPORT_ASSEMBLE_H

#include <stdbool.h>

#include "coordinator/scene/builder.h"

struct kiln_attributes {
    /* `normal`: for the normal map; `gloss`: for the textures of gloss; each is stored only if the scene has any */
    struct kiln_vec2 base, emission, lightmap, normal, gloss;
    uint8_t color[4];
};

/* A primitive of a mesh, read through callbacks. They are called for vertices below `vertex_count` only, as often as
 * needed. */
struct kiln_primitive {
    const char *where; /* "scene.glb: meshes[3].primitives[0]": begins error sentences */
    void *context;
    size_t vertex_count;
    size_t triangle_count;
    bool has_normals;
    bool posed;  /* positions differ from the file (KILN_MESH_POSED) */
    bool turned; /* `corners` exchanges the last two corners of the file */
    uint32_t material;
    /* index among the primitives of its mesh in the file; kept with each triangle (struct kiln_triangle_source) */
    uint32_t index;
    /* The corners of triangle k as the file has them. */
    void (*corners)(void *context, size_t triangle, uint32_t corner[3]);
    void (*geometry)(void *context, uint32_t vertex, struct kiln_vec3 *position, struct kiln_vec3 *normal);
    void (*attributes)(void *context, uint32_t vertex, struct kiln_attributes *attributes);
};

/* Counts of changes over all primitives that were added with this struct. */
struct kiln_assembly_counts {
    uint64_t without_area, replaced_normals;
};

/* Begins a mesh at the end of the builder. Add its primitives with kiln_mesh_add before the next mesh begins. */
int kiln_mesh_begin(struct kiln_builder *builder, const char *name, uint32_t *mesh, struct kiln_error *error);
int kiln_mesh_add(struct kiln_builder *builder, uint32_t mesh, const struct kiln_primitive *primitive,
                  struct kiln_assembly_counts *counts, struct kiln_error *error);

/* Adds a note on each of the first objects whose triangles are wound against their normals, and one note on the rest.
 * Call it after the last object. */
int kiln_note_winding(struct kiln_builder *builder, struct kiln_error *error);

/* Adds a note on objects with too coarse coordinates: the spacing of the file's coordinates, floats of 24 bits, exceeds
 * a tenth of a texel of the scene's mean density. Far from their mesh's origin such vertices are displaced, and
 * triangles collapse. Call it when lightmaps have their sizes. */
int kiln_note_coarse_coordinates(struct kiln_builder *builder, struct kiln_error *error);

/* Appends an object, unless it has no area in the world: then *skipped is set. `transform` is checked to be finite;
 * `name` and `original` are as in struct kiln_object. `source` (NULL: unknown) is the object's place in its file.
 * `where` begins error sentences. */
struct kiln_object_source {
    uint32_t node, mesh, instance; /* as in struct kiln_object */
};
int kiln_object_add(struct kiln_builder *builder, uint32_t mesh, const double transform[12], const char *name,
                    const char *original, const struct kiln_object_source *source, const char *where, bool *skipped,
                    struct kiln_error *error);

#endif
