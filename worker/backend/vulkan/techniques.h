/* Data on the device for light paths that land, and for gather rays weighted against them (struct kiln_gpu_land): aims,
 * targets, and the light tree as emission.glsl reads it. */
#ifndef KILN_WORKER_BACKEND_VULKAN_TECHNIQUES_H
#define KILN_WORKER_BACKEND_VULKAN_TECHNIQUES_H

#include "worker/backend/vulkan/gpu/gpu.h"
#include "worker/backend/vulkan/layout.h"

struct kiln_aims;
struct kiln_gpu_both;
struct vulkan_backend;
struct kiln_caustic_techniques;

enum { VULKAN_TECHNIQUE_BUFFERS = 13 };

struct vulkan_techniques {
    struct gpu_buffer buffers[VULKAN_TECHNIQUE_BUFFERS];
    struct gpu_buffer areas; /* lit areas of points, for the weighed pass (weighed.c) */
    uint64_t both;           /* address of a struct kiln_gpu_both; a struct kiln_gpu_land lies before it */
};

/* Uploads into b->techniques, which is empty before, the aims, whose numbers of paths are set, and the parts of
 * `techniques` (NULL: none) that kernels read. Includes the data of unfinished paths in `under_way` (NULL: none) and
 * existing spheres of probes (spheres.h). All arguments are read only during the call. Release with
 * vulkan_techniques_release, also after a failure; a device that was set up again has none. */
int vulkan_techniques_create(struct vulkan_backend *b, const struct kiln_aims *aims,
                             const struct kiln_caustic_techniques *techniques, const struct kiln_gpu_both *under_way,
                             struct kiln_error *error);
void vulkan_techniques_release(struct vulkan_backend *b);

#endif
