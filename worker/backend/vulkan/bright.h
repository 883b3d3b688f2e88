/* Rays to bright patches on the device (shaders/bright.glsl). Clusters and patches stay on the device for a call of the
 * directions pass. The distribution for the points of a chunk is made on the host and uploaded with the chunk. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BRIGHT_H
#define KILN_WORKER_BACKEND_VULKAN_BRIGHT_H

#include "worker/backend/vulkan/hemisphere.h"
#include "worker/pass/bright.h"

/* Uploads clusters and patches; again after each recovery. */
int vulkan_bright_prepare(struct vulkan_backend *b, const struct kiln_bright *bright, struct kiln_error *error);

/* Function for vulkan_hemisphere.bring; its parameters are struct kiln_directions_parameters. */
int vulkan_bright_bring(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch,
                        const struct vulkan_chunk *chunk, uint64_t room, struct vulkan_recording *recording,
                        struct kiln_error *error);

/* Returns the approximate number of bytes a point that vulkan_bright_bring uploads. */
size_t vulkan_bright_bytes(const struct kiln_bright *bright);

void vulkan_bright_release(struct vulkan_backend *b);

#endif
