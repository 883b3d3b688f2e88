/* The light of groups of lights (worker/pass/groups.h). The direct pass adds up what each sample brings for its light's
 * group (shaders/light_groups.glsl, direct_groups.comp). The gather pass keeps what its rays meet on the device
 * (keep.comp), chunk by chunk, and gathers from that the radiosity of up to KILN_ROW_LIGHTS groups at once
 * (replay_groups.comp). Answers of a chunk return beside those of the whole light. */
#ifndef KILN_WORKER_BACKEND_VULKAN_GROUPS_H
#define KILN_WORKER_BACKEND_VULKAN_GROUPS_H

#include "worker/backend/vulkan/chunks.h"
#include "worker/light/light_groups.h"
#include "worker/pass/groups.h"

/* Number of groups, and of floats that the device answers for a point; 0: nobody asks for their light. */
static inline uint32_t vulkan_groups_count(const struct vulkan_backend *b)
{
    return b->base.given.groups != NULL ? b->base.given.groups->lights->count : 0;
}
uint32_t vulkan_groups_floats(const struct vulkan_backend *b);

/* Brings which group each light is in. */
int vulkan_groups_of_lights(struct vulkan_backend *b, struct kiln_error *error);
/* Brings the radiosity of all groups, if it has changed, to b->group_lights. */
int vulkan_groups_radiosity(struct vulkan_backend *b, struct kiln_error *error);

/* Before a pass's first chunk, and after each recovery: no chunk has answers. */
void vulkan_groups_begin(struct vulkan_backend *b);
/* Before a chunk's first portion: room for its answers in its slot's `groups`. */
int vulkan_groups_room(struct vulkan_backend *b, const struct vulkan_chunk *chunk, struct kiln_error *error);
/* After its last one: records the way of the answers to the host. */
void vulkan_groups_bring(struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                         struct vulkan_recording *recording);
/* Hands over the answers of consecutive tile runs of a chunk, before the batch's taker gets those of all light. */
int vulkan_groups_take(struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run_first,
                       size_t tile_run_count, struct kiln_error *error);

/* Gives up what lies on the device. */
void vulkan_groups_release(struct vulkan_backend *b);

#endif
