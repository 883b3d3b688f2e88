/* From a file's corners to kiln's vertices and triangles: what every reader does after it has understood its format.
 *
 * The rules, the same for all formats:
 * - The winding decides the front face (counter-clockwise). Where the three normals of a triangle lean to the other
 * side they are turned round, or with builder->trust_normals the triangle is; a single corner normal that still leans
 * away is replaced by the geometric one.
 * - A missing or zero normal becomes the geometric one; a primitive whose normals are all zero is refused.
 * - A triangle without area (2 A <= 1e-12 x longest edge squared) is left out and counted.
 * - Only vertices that a kept triangle uses are stored; corners share a vertex when they come from the same vertex of
 * the file and have the same normal.
 * - KILN_MESH_SMOOTH is set where a normal differs from the geometric one by more than 1e-3.
 * - Coordinates are finite and at most KILN_COORDINATE_MAX in size. */
#ifndef KILN_COORDINATOR_IMPORT_ASSEMBLE_H
#define KILN_COORDINATOR_IMPORT_ASSEMBLE_H

#include <stdbool.h>

#include "coordinator/scene/builder.h"

struct kiln_attributes {
    struct kiln_vec2 base, emission, lightmap;
    uint8_t color[4];
};

/* Where a primitive's vertices come from. The readers are called for vertices below `vertex_count` only, as often as
 * needed. */
struct kiln_primitive {
    const char *where; /* "scene.glb: meshes[3].primitives[0]", begins sentences */
    void *context;
    size_t vertex_count;
    size_t triangle_count;
    bool has_normals;
    uint32_t material;
    /* which of its mesh's primitives in the file: kept with each triangle, see struct kiln_triangle_source */
    uint32_t index;
    /* Corners of triangle k as the file has them. */
    void (*corners)(void *context, size_t triangle, uint32_t corner[3]);
    void (*geometry)(void *context, uint32_t vertex, struct kiln_vec3 *position, struct kiln_vec3 *normal);
    void (*attributes)(void *context, uint32_t vertex, struct kiln_attributes *attributes);
};

/* What was changed on the way, over all primitives that were given this struct. */
struct kiln_assembly_counts {
    uint64_t without_area, replaced_normals;
};

/* Begins a mesh at the end of the builder; add primitives, then end. One mesh at a time. */
int kiln_mesh_begin(struct kiln_builder *builder, const char *name, uint32_t *mesh, struct kiln_error *error);
int kiln_mesh_add(struct kiln_builder *builder, uint32_t mesh, const struct kiln_primitive *primitive,
                  struct kiln_assembly_counts *counts, struct kiln_error *error);

/* A note for each of the first objects with triangles wound against their normals, and one for the rest. After the last
 * object. */
int kiln_note_winding(struct kiln_builder *builder, struct kiln_error *error);

/* Appends an object unless it has no area in the world (which *skipped tells). `transform` is checked to be finite;
 * name and original are as in struct kiln_object. `source` (NULL: not known) says where it stands in its file. */
struct kiln_object_source {
    uint32_t node, mesh, instance; /* as in struct kiln_object */
};
int kiln_object_add(struct kiln_builder *builder, uint32_t mesh, const double transform[12], const char *name,
                    const char *original, const struct kiln_object_source *source, const char *where, bool *skipped,
                    struct kiln_error *error);

#endif
