/* Private to gltf_again.c and again_mesh.c: a source's glTF on its way to being written again. */
#ifndef KILN_COORDINATOR_EXPORT_AGAIN_H
#define KILN_COORDINATOR_EXPORT_AGAIN_H

#include "coordinator/export/glb_build.h"
#include "coordinator/import/gltf_document.h"

struct again {
    struct gltf g;
    struct kiln_glb_build b; /* its root is g's */
    const struct kiln_scene *scene;
    json_t *plan;
    const struct kiln_vec2 *coordinates; /* a vertex of the scene */
    uint32_t *set_of;                    /* a mesh: which TEXCOORD holds the lightmap's coordinates */
};

/* Gives every mesh that was baked its lightmap coordinates: TEXCOORD_1 as it stands where that is what was baked, else
 * new ones. */
void kiln_again_meshes(struct again *a);

#endif
