/* Rays to bright patches on the device (shaders/bright.glsl): clusters and patches stay for a call of the directions
 * pass; what the points of a chunk choose by goes with the chunk, made on the host. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BRIGHT_H
#define KILN_WORKER_BACKEND_VULKAN_BRIGHT_H

#include "worker/backend/vulkan/hemisphere.h"
#include "worker/pass/bright.h"

/* Brings clusters and patches; again after each recovery. */
int vulkan_bright_prepare(struct vulkan_backend *b, const struct kiln_bright *bright, struct kiln_error *error);

/* vulkan_hemisphere.bring, whose parameters are struct kiln_directions_parameters. */
int vulkan_bright_bring(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch,
                        const struct vulkan_chunk *chunk, uint64_t room, struct vulkan_recording *recording,
                        struct kiln_error *error);

/* Bytes of a point, about, that the latter brings. */
size_t vulkan_bright_bytes(const struct kiln_bright *bright);

void vulkan_bright_release(struct vulkan_backend *b);

#endif
