/* Lights on the device, for shaders/lights.glsl. */
#ifndef KILN_WORKER_BACKEND_VULKAN_LIGHTS_H
#define KILN_WORKER_BACKEND_VULKAN_LIGHTS_H

#include "worker/backend/vulkan/gpu/gpu.h"
#include "worker/light/lights.h"

#include "shaders/shared/layout.h"

enum { VULKAN_LIGHT_BUFFERS = 8 };

struct vulkan_lights {
    struct gpu_buffer buffers[VULKAN_LIGHT_BUFFERS];
    uint32_t kinds; /* KILN_GPU_KIND_* bits: the specialisation constant LIGHT_KINDS */
};

/* Uploads the lights of `model`, and writes addresses and numbers into `layout`. `float64`: for kernels whose `real` is
 * double. `model` is read only during the call. KILN_NO_DEVICE when it does not fit, KILN_SYSTEM. Not collective. */
int vulkan_lights_create(struct gpu *gpu, const struct kiln_lights *model, bool float64, struct vulkan_lights *lights,
                         struct kiln_gpu_lights *layout, struct kiln_error *error);
void vulkan_lights_destroy(struct gpu *gpu, struct vulkan_lights *lights);

/* Bytes of a struct kiln_gpu_direct_sums on the device. */
size_t vulkan_lights_sums_bytes(bool float64);

#endif
