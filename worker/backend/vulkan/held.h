/* Light that the device keeps from bounce to bounce (worker/pass/held.h): its buffers, upload and download. kept_rows.c
 * runs the gathers in between, whose answers shaders/replay_take.comp takes over. */
#ifndef KILN_WORKER_BACKEND_VULKAN_HELD_H
#define KILN_WORKER_BACKEND_VULKAN_HELD_H

#include "worker/backend/vulkan/vulkan.h"

extern const struct vulkan_shader vulkan_held_powers; /* shaders/held_powers.comp */

/* kiln_backend_hold, kiln_backend_hold_fetch. */
int vulkan_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held, struct kiln_held_power *powers,
                struct kiln_error *error);
int vulkan_hold_fetch(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                      struct kiln_error *error);

/* vulkan_held_begin prepares the radiosity that a step gathers from (layout.from), and the target of its answers.
 * vulkan_held_end, after the gather, returns the sums. KILN_NO_DEVICE: an answer is not good. */
int vulkan_held_begin(struct vulkan_backend *b, const struct kiln_held_step *step, uint32_t stream,
                      struct kiln_error *error);
int vulkan_held_end(struct vulkan_backend *b, struct kiln_held_power *powers, struct kiln_error *error);
/* Drops held light after a failure, whose status it returns; a lost device is set up again. */
int vulkan_held_fail(struct vulkan_backend *b, int status, struct kiln_error *error);

void vulkan_held_release(struct vulkan_backend *b);

#endif
