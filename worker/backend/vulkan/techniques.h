/* Light paths that land, and what gather rays share with them, on the device (struct kiln_gpu_land): aims, targets, and
 * the light tree as emission.glsl reads it. */
#ifndef KILN_WORKER_BACKEND_VULKAN_TECHNIQUES_H
#define KILN_WORKER_BACKEND_VULKAN_TECHNIQUES_H

#include "worker/backend/vulkan/vulkan.h"

struct kiln_aims;
struct kiln_caustic_techniques;

enum { VULKAN_TECHNIQUE_BUFFERS = 10 };

struct vulkan_techniques {
    struct gpu_buffer buffers[VULKAN_TECHNIQUE_BUFFERS];
    struct kiln_gpu_land root; /* for vulkan_techniques_root once all of it is set */
    struct gpu_buffer root_buffer;
    uint64_t both; /* the address of a struct kiln_gpu_both */
};

/* Uploads the aims, which are shared out, and of `techniques`, NULL where there are none, what kernels read. Both are
 * read only during the call. Release with vulkan_techniques_release, also after a failure. */
int vulkan_techniques_create(struct vulkan_backend *b, const struct kiln_aims *aims,
                             const struct kiln_caustic_techniques *techniques, struct vulkan_techniques *t,
                             struct kiln_error *error);
void vulkan_techniques_release(struct vulkan_backend *b, struct vulkan_techniques *t);

#endif
