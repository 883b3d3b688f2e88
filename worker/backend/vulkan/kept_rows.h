/* The gather pass with kept rays (worker/pass/rows.h): shaders/keep.comp writes a word for each ray in addition to the
 * sums, and shaders/replay.comp reads it instead of tracing. Both sum in the same order as gather.comp, so that all
 * give the same bits.
 *
 * Rows in a file, or too large for the device, are uploaded chunk by chunk. Rows that stay in the host's memory
 * (worker/pass/resident_rows.h) also stay on the device, if they take at most half of its free memory. */
#ifndef KILN_WORKER_BACKEND_VULKAN_KEPT_ROWS_H
#define KILN_WORKER_BACKEND_VULKAN_KEPT_ROWS_H

#include "worker/backend/vulkan/hemisphere.h"

/* Whether this backend can keep rays of the gather pass: they end at their first hit, and no light is tinted. */
bool vulkan_keeps_rows(const struct vulkan_backend *b);

/* Runs the gather pass with b->base.given.rows. */
int vulkan_gather_rows(struct vulkan_backend *b, const struct kiln_batch *batch, uint64_t *rays,
                       struct kiln_error *error);

/* Runs the gather pass described by `pass`, and computes the light of groups as well (groups.h). */
int vulkan_gather_groups(struct vulkan_backend *b, struct vulkan_hemisphere *pass, const struct kiln_batch *batch,
                         uint64_t *rays, struct kiln_error *error);

/* kiln_backend_replay. */
int vulkan_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights, size_t count,
                  const struct kiln_batch *batch, struct kiln_error *error);

/* kiln_backend_hold_step. */
int vulkan_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                     const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error);

/* Releases the rows on the device. */
void vulkan_rows_release(struct vulkan_backend *b);

#endif
