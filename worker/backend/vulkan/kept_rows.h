/* The gather pass whose rays are kept, or were (worker/pass/rows.h): shaders/keep.comp leaves a word for each ray
 * beside the sums, shaders/replay.comp reads it in the place of tracing. Both add up as gather.comp does, so that all
 * have the same bits.
 *
 * Rows in a file, or too large for the device, are brought chunk by chunk. Rows that stay in the host's memory
 * (worker/pass/resident_rows.h) stay on the device too, where they take no more than half of what is left there. */
#ifndef KILN_WORKER_BACKEND_VULKAN_KEPT_ROWS_H
#define KILN_WORKER_BACKEND_VULKAN_KEPT_ROWS_H

#include "worker/backend/vulkan/hemisphere.h"

/* Whether rays of the gather pass can be kept here: they end where they first meet something, and no light is tinted.
 */
bool vulkan_keeps_rows(const struct vulkan_backend *b);

/* The gather pass with b->base.given.rows. */
int vulkan_gather_rows(struct vulkan_backend *b, const struct kiln_batch *batch, uint64_t *rays,
                       struct kiln_error *error);

/* The gather pass as it stands in `pass`, and the light of groups besides (groups.h). */
int vulkan_gather_groups(struct vulkan_backend *b, struct vulkan_hemisphere *pass, const struct kiln_batch *batch,
                         uint64_t *rays, struct kiln_error *error);

/* kiln_backend_replay. */
int vulkan_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights, size_t count,
                  const struct kiln_batch *batch, struct kiln_error *error);

/* kiln_backend_hold_step. */
int vulkan_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                     const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error);

/* Gives up what lies on the device. */
void vulkan_rows_release(struct vulkan_backend *b);

#endif
