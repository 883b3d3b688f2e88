/* The state of a source's glTF while it is read and written again. Private to gltf_rewrite.c and
 * gltf_rewrite_mesh.c. */
#ifndef KILN_COORDINATOR_EXPORT_GLTF_REWRITE_H
#define KILN_COORDINATOR_EXPORT_GLTF_REWRITE_H

#include "coordinator/export/glb_build.h"
#include "coordinator/import/gltf_document.h"

struct rewrite {
    struct gltf g;
    struct kiln_glb_build b; /* its JSON root is that of `g` */
    const struct kiln_scene *scene;
    json_t *plan;
    const struct kiln_vec2 *coordinates; /* per vertex of the scene: lightmap coordinates */
    /* per mesh: the number of the TEXCOORD set that holds the lightmap's coordinates */
    uint32_t *set_of;
};

/* Gives every baked mesh its lightmap coordinates: keeps TEXCOORD_1 where that is what was baked, else writes new
 * ones. */
void kiln_rewrite_meshes(struct rewrite *a);

#endif
