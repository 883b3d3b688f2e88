/* The state of a source's glTF while it is read and written again. Private to gltf_rewrite.c, gltf_rewrite_mesh.c and
 * gltf_rewrite_light.c. */
#ifndef KILN_COORDINATOR_EXPORT_GLTF_REWRITE_H
#define KILN_COORDINATOR_EXPORT_GLTF_REWRITE_H

#include "coordinator/export/glb_build.h"
#include "coordinator/import/gltf_document.h"

/* Correspondence between the vertices of a written primitive and the vertices of the scene. */
struct written_corners {
    size_t mesh, primitive;
    size_t count, vertex_count; /* corners; vertices of the primitive */
    /* per corner: the primitive's vertex, and the vertex of the scene's mesh (KILN_NONE: a triangle without area) */
    uint32_t *vertex, *of_mesh;
};

struct rewrite {
    struct gltf g;
    struct kiln_glb_build b; /* its JSON root is that of `g` */
    const struct kiln_scene *scene;
    json_t *plan;
    const struct kiln_vec2 *coordinates; /* per vertex of the scene: lightmap coordinates */
    /* per mesh: the number of the TEXCOORD set that holds the lightmap's coordinates */
    uint32_t *set_of;
    uint32_t *mesh_of;       /* per mesh of the scene: the written mesh of the file; KILN_NONE: no object has it */
    const float (*light)[3]; /* per vertex of each object: irradiance; NULL: none */
    /* with `light`: all primitives of baked meshes, by mesh in the order of the objects */
    struct written_corners *corners;
    size_t corner_count, corner_capacity;
};

/* Gives every baked mesh its lightmap coordinates: keeps TEXCOORD_1 if it holds the baked coordinates, else writes new
 * ones. */
void kiln_rewrite_meshes(struct rewrite *a);

/* Gives every baked node a mesh with its light as COLOR_1. After kiln_rewrite_meshes. */
void kiln_rewrite_light(struct rewrite *a);
/* Releases `corners`. */
void kiln_rewrite_corners_free(struct rewrite *a);

#endif
