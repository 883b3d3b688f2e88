/* Materials and textures on the device, for shaders/material.glsl. Only data that kernels read are uploaded: coatings
 * of triangles that may let rays through or whose emission has a texture, and their textures. A scene without such
 * triangles uploads nothing. Paths and chains need all triangles. */
#ifndef KILN_WORKER_BACKEND_VULKAN_MATERIALS_H
#define KILN_WORKER_BACKEND_VULKAN_MATERIALS_H

#include "worker/backend/backend.h"
#include "worker/backend/vulkan/gpu/gpu.h"
#include "worker/backend/vulkan/layout.h"
#include "worker/material/surface_bsdf.h"

enum { VULKAN_MATERIAL_BUFFERS = 9 };

struct vulkan_materials {
    /* materials, textures, coatings, slots, table of sRGB codes, glosses, their texture coordinates, their lobes, and
     * normals of panes */
    struct gpu_buffer buffers[VULKAN_MATERIAL_BUFFERS];
    /* buffers of texels: several, since one may exceed the largest size that the device allows */
    struct gpu_buffer *texels;
    size_t texel_buffers;
    struct kiln_gloss_lobes *lobes; /* of each material, on the host; NULL: all are diffuse to kernels */
    struct gpu_buffer tables;       /* kiln_scene_tables */
    bool gloss;                     /* kernels treat some materials as not purely diffuse */
    bool varied;                    /* lobes of some materials vary over the surface (KILN_GPU_GLOSS_PREPARED) */
    bool brushed, trapped;          /* some materials have tables of brushed facets; of light trapped under coats */
    uint32_t lobe_kinds;            /* KILN_BSDF_MAY_...: kinds of lobes that some material may have */
    uint32_t textured;              /* KILN_TEXTURED_...: what has textures in the scene */
};

/* Uploads materials, and writes the addresses into `layout` (all 0 when there is nothing); with `all` the coatings of
 * all triangles, and the data of their colours and gloss. `params` are read only during the call. KILN_NO_DEVICE when
 * it does not fit, KILN_SYSTEM. Not collective. */
int vulkan_materials_create(struct gpu *gpu, const struct kiln_backend_params *params, bool all,
                            struct vulkan_materials *materials, struct kiln_gpu_materials *layout,
                            struct kiln_error *error);
/* Whether light transport simulates the gloss of some materials of the scene. */
bool vulkan_materials_take_gloss(const struct kiln_scene *scene);
void vulkan_materials_destroy(struct gpu *gpu, struct vulkan_materials *materials);

/* Whether kernels other than the path kernel may read the material of world triangle `triangle`: it decides what is
 * uploaded, and what the test covers. */
bool vulkan_materials_holds(const struct kiln_backend_params *params, uint32_t triangle);

#endif
