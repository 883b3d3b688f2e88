/* Writes glTF 2.0 binary files (.glb): meshes, materials with emissive strength, nodes with translation, rotation and
 * scale, cameras, punctual lights, and the environment as scenes[0].extras.environment. Vertex data is kept in memory
 * in the order it is added; the same calls give the same bytes. Not collective.
 *
 * Units as in glTF: metres, linear RGB, y up, counter-clockwise front faces; emission is radiance. */
#ifndef KILN_COORDINATOR_GENERATE_GLB_H
#define KILN_COORDINATOR_GENERATE_GLB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

#define KILN_GLB_LARGEST 4294967295.0 /* bytes: a .glb stores its length in 32 bits */

struct kiln_glb;

struct kiln_glb_material {
    const char *name;
    float base_color[3];
    float emission[3]; /* radiance */
    float metallic, roughness;
    bool transmissive; /* KHR_materials_transmission of 1, with this index of refraction; 0: 1.5 */
    float ior;
    /* thickness of KHR_materials_volume, if transmissive, m; 0: a thin wall. The mesh has to be closed */
    float thickness;
    float attenuation_color[3], attenuation_distance; /* m; 0: the body absorbs nothing */
    float dispersion;                                 /* KHR_materials_dispersion: 20 / Abbe number; 0: none */
};

/* A glTF primitive: triangles of one material. The primitives of a mesh index the mesh's one vertex array. */
struct kiln_glb_primitive {
    uint32_t material;
    size_t index_first, index_count;
};

struct kiln_glb_mesh {
    const char *name;
    size_t vertex_count;
    const struct kiln_vec3 *positions;
    const struct kiln_vec3 *normals;    /* NULL: none */
    const struct kiln_vec2 *texcoord_0; /* NULL: none */
    const struct kiln_vec2 *texcoord_1; /* NULL: none */
    const uint32_t *indices;
    const struct kiln_glb_primitive *primitives; /* empty ones are skipped */
    size_t primitive_count;
};

/* A node's transform. Scale (0,0,0) means none, rotation (0,0,0,0) too. */
struct kiln_glb_placement {
    double translation[3];
    double rotation[4]; /* unit quaternion x y z w */
    double scale[3];
};

struct kiln_glb_totals {
    uint64_t triangles, triangles_placed; /* stored triangles; and counted once for each node that shows them */
    uint64_t meshes, nodes;
    uint64_t bytes; /* size of the file, once written */
};

int kiln_glb_create(struct kiln_glb **glb, struct kiln_error *error);
void kiln_glb_destroy(struct kiln_glb **glb);

int kiln_glb_add_material(struct kiln_glb *glb, const struct kiln_glb_material *material, uint32_t *index,
                          struct kiln_error *error);
/* KILN_USAGE when the file would exceed the 4 GiB that a .glb can hold. */
int kiln_glb_add_mesh(struct kiln_glb *glb, const struct kiln_glb_mesh *mesh, uint32_t *index,
                      struct kiln_error *error);
int kiln_glb_add_node(struct kiln_glb *glb, const char *name, uint32_t mesh, const struct kiln_glb_placement *placement,
                      struct kiln_error *error);
/* Adds a perspective camera: `angle` is the vertical angle of view in radians; it looks along -z of the placement. */
int kiln_glb_add_camera(struct kiln_glb *glb, const char *name, double angle, double aspect, double near,
                        const struct kiln_glb_placement *placement, struct kiln_error *error);
/* Adds a directional light along -z of the placement; `intensity` is the irradiance on a facing surface. */
int kiln_glb_add_sun(struct kiln_glb *glb, const char *name, const double color[3], double intensity,
                     const struct kiln_glb_placement *placement, struct kiln_error *error);
/* Adds a point light at the placement; `intensity` is W/sr. */
int kiln_glb_add_point(struct kiln_glb *glb, const char *name, const double color[3], double intensity,
                       const struct kiln_glb_placement *placement, struct kiln_error *error);
/* Adds a spot light along -z of the placement; `intensity` is W/sr; angles are radians from the axis, inner < outer. */
int kiln_glb_add_spot(struct kiln_glb *glb, const char *name, const double color[3], double intensity, double inner,
                      double outer, const struct kiln_glb_placement *placement, struct kiln_error *error);
/* Sets the environment to a constant radiance. */
int kiln_glb_set_environment(struct kiln_glb *glb, const double radiance[3], struct kiln_error *error);
/* Sets a sentence about the scene, stored as scenes[0].extras.note. */
int kiln_glb_set_note(struct kiln_glb *glb, const char *note, struct kiln_error *error);

void kiln_glb_totals(const struct kiln_glb *glb, struct kiln_glb_totals *totals);

/* Writes the file under a temporary name, syncs it and renames it. KILN_CANNOT_CREATE, KILN_PERMISSION, KILN_IO. */
int kiln_glb_write(struct kiln_glb *glb, const char *path, struct kiln_error *error);

#endif
