/* Visibility between pairs of patches, on the device: the grid that tells it (worker/scene/voxels.h), and what is kept
 * from step to step (worker/pass/visibility_cache.h).
 *
 * What is kept lies on the device alone. Each own tile run has its part of what the cache may take, by its points
 * (struct kiln_gpu_sight_run), in buffers of VISIBILITY_BUFFER bytes at most; of the device's memory half of what is
 * left is taken at most. What finds no room is traced in each step. While a chunk is under way its points have a bit
 * for each column in the chunk's scratch: sight_open.comp lays out what is known, patches.comp reads it and adds to it,
 * sight_close.comp and sight_store.comp keep it. A device that was lost has forgotten all. */
#ifndef KILN_WORKER_BACKEND_VULKAN_VISIBILITY_H
#define KILN_WORKER_BACKEND_VULKAN_VISIBILITY_H

#include "worker/backend/vulkan/chunks.h"
#include "worker/pass/patches.h"
#include "worker/pass/visibility_cache.h"

/* The own constant of patches.comp: KILN_GPU_SIGHT_... */
uint32_t vulkan_visibility_sight(const struct vulkan_backend *b, const struct kiln_patches_parameters *p);

/* Bytes of scratch of a point. */
size_t vulkan_visibility_scratch(const struct vulkan_backend *b, const struct kiln_patches_parameters *p);

/* Brings the grid, makes room for what is kept, and forgets what does not hold any more; again after each recovery. */
int vulkan_visibility_prepare(struct vulkan_backend *b, const struct kiln_patches_parameters *p,
                              const struct kiln_batch *batch, struct kiln_error *error);

/* The chunk's first and last steps, where something is kept; `push`: of its pairs. */
void vulkan_visibility_open(const struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                            const struct kiln_gpu_patches_push *push, struct vulkan_recording *recording);
void vulkan_visibility_close(const struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                             const struct kiln_gpu_patches_push *push, struct vulkan_recording *recording);

/* After a pass: what is kept now. */
int vulkan_visibility_count(struct vulkan_backend *b, struct kiln_visibility_counts *counts, struct kiln_error *error);

void vulkan_visibility_release(struct vulkan_backend *b);

#endif
