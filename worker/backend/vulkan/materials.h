/* Materials and textures on the device, for shaders/material.glsl. Only what kernels ask for is uploaded: coatings of
 * triangles that may let rays through or whose emission has a texture, and the textures these need. Nothing at all in a
 * scene without. Paths and chains ask for all triangles. */
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
    /* as many buffers as the texels need: one alone may be no larger than the device allows */
    struct gpu_buffer *texels;
    size_t texel_buffers;
    struct kiln_gloss_lobes *lobes; /* of each material, on the host; NULL: all are diffuse to kernels */
    struct gpu_buffer tables;       /* kiln_scene_tables */
    bool gloss;                     /* some materials are not only diffuse to kernels */
    bool varied;                    /* and the lobes of some are not the same all over (KILN_GPU_GLOSS_PREPARED) */
    bool brushed, held;             /* and some have tables of brushed facets, of what coats hold back */
};

/* Uploads and writes the addresses into `layout` (all 0 when there is nothing); with `all` the coatings of all
 * triangles, and what their colours and their gloss need. `params` are read only during the call. KILN_NO_DEVICE when
 * it does not fit, KILN_SYSTEM. Not collective. */
int vulkan_materials_create(struct gpu *gpu, const struct kiln_backend_params *params, bool all,
                            struct vulkan_materials *materials, struct kiln_gpu_materials *layout,
                            struct kiln_error *error);
/* Whether light transport takes some materials of the scene with their gloss. */
bool vulkan_materials_take_gloss(const struct kiln_scene *scene);
void vulkan_materials_destroy(struct gpu *gpu, struct vulkan_materials *materials);

/* Whether kernels other than that of paths may ask for world triangle `triangle`: what is uploaded, and what the test
 * goes through. */
bool vulkan_materials_holds(const struct kiln_backend_params *params, uint32_t triangle);

#endif
