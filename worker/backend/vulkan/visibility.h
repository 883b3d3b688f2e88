/* Visibility between pairs of patches, on the device: the voxel grid that approximates it (worker/scene/voxels.h), and
 * the results kept from step to step (worker/pass/visibility_cache.h).
 *
 * Kept results are stored only on the device. Each of this rank's tile runs has a share of the cache, in proportion to
 * its points (struct kiln_gpu_sight_run), in buffers of at most VISIBILITY_BUFFER bytes; the cache takes at most half
 * of the device's free memory. Pairs without room are traced in each step. While a chunk is processed its points have a
 * bit for each column in the chunk's scratch. sight_open.comp writes known results there, patches.comp reads and
 * extends them, sight_close.comp and sight_store.comp store them. The loss of a device loses all. */
#ifndef KILN_WORKER_BACKEND_VULKAN_VISIBILITY_H
#define KILN_WORKER_BACKEND_VULKAN_VISIBILITY_H

#include "worker/backend/vulkan/chunks.h"
#include "worker/pass/patches.h"
#include "worker/pass/visibility_cache.h"

/* Returns the value of patches.comp's own specialisation constant: KILN_GPU_SIGHT_... */
uint32_t vulkan_visibility_sight(const struct vulkan_backend *b, const struct kiln_patches_parameters *p);

/* Bytes of scratch of a point. */
size_t vulkan_visibility_scratch(const struct vulkan_backend *b, const struct kiln_patches_parameters *p);

/* Uploads the grid, allocates memory for kept results, and drops those that are not valid any more; again after each
 * recovery. */
int vulkan_visibility_prepare(struct vulkan_backend *b, const struct kiln_patches_parameters *p,
                              const struct kiln_batch *batch, struct kiln_error *error);

/* Record the chunk's first and last steps, if results are kept; `push`: push constants of the chunk's pairs. */
void vulkan_visibility_open(const struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                            const struct kiln_gpu_patches_push *push, struct vulkan_recording *recording);
void vulkan_visibility_close(const struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                             const struct kiln_gpu_patches_push *push, struct vulkan_recording *recording);

/* Counts the kept results, after a pass. */
int vulkan_visibility_count(struct vulkan_backend *b, struct kiln_visibility_counts *counts, struct kiln_error *error);

void vulkan_visibility_release(struct vulkan_backend *b);

#endif
