/* Light of each group of lights (worker/pass/groups.h). The direct pass sums the contribution of each sample for its
 * light's group (shaders/light_groups.glsl, direct_groups.comp). The gather pass stores its rays' hits on the device
 * (keep.comp), chunk by chunk, and from these gathers the radiosity of up to KILN_ROW_LIGHTS groups at once
 * (replay_groups.comp). A chunk's answers by groups are returned together with those of the whole light. */
#ifndef KILN_WORKER_BACKEND_VULKAN_GROUPS_H
#define KILN_WORKER_BACKEND_VULKAN_GROUPS_H

#include "worker/backend/vulkan/chunks.h"
#include "worker/light/light_groups.h"
#include "worker/pass/groups.h"

/* vulkan_groups_count: number of groups, 0: not requested. vulkan_groups_floats: number of floats that the device
 * returns for a point. */
static inline uint32_t vulkan_groups_count(const struct vulkan_backend *b)
{
    return b->base.given.groups != NULL ? b->base.given.groups->lights->count : 0;
}
uint32_t vulkan_groups_floats(const struct vulkan_backend *b);

/* Uploads the group of each light. */
int vulkan_groups_of_lights(struct vulkan_backend *b, struct kiln_error *error);
/* Uploads the radiosity of all groups, if it has changed, to b->group_lights. */
int vulkan_groups_radiosity(struct vulkan_backend *b, struct kiln_error *error);

/* Resets the state before a pass's first chunk and after each recovery: no chunk has answers. */
void vulkan_groups_begin(struct vulkan_backend *b);
/* Allocates the chunk's answers in its slot's `groups`; before the chunk's first portion. */
int vulkan_groups_room(struct vulkan_backend *b, const struct vulkan_chunk *chunk, struct kiln_error *error);
/* Records the copy of the chunk's answers to the host; after its last portion. */
void vulkan_groups_bring(struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                         struct vulkan_recording *recording);
/* Hands over the groups' answers for consecutive tile runs of a chunk, before the batch's taker gets the answers of the
 * whole light. */
int vulkan_groups_take(struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run_first,
                       size_t tile_run_count, struct kiln_error *error);

/* Releases the groups' data on the device. */
void vulkan_groups_release(struct vulkan_backend *b);

#endif
