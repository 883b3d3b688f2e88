/* Light paths that land, and what gather rays share with them, on the device (struct kiln_gpu_land): aims, targets, and
 * the light tree as emission.glsl reads it. */
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
    struct gpu_buffer areas; /* of points, where rays are gathered (weighed.c) */
    uint64_t both;           /* the address of a struct kiln_gpu_both, before which a struct kiln_gpu_land lies */
};

/* Uploads into b->techniques, which holds nothing yet, the aims, which are shared out, and of `techniques`, NULL where
 * there are none, what kernels read; with what `under_way` has of paths under way (NULL: nothing) and the spheres of
 * probes that are there (spheres.h). All are read only
 * during the call. Release with vulkan_techniques_release, also
 * after a failure; a device that is made anew has none. */
int vulkan_techniques_create(struct vulkan_backend *b, const struct kiln_aims *aims,
                             const struct kiln_caustic_techniques *techniques, const struct kiln_gpu_both *under_way,
                             struct kiln_error *error);
void vulkan_techniques_release(struct vulkan_backend *b);

#endif
