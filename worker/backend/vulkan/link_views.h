/* Finding the links of tile runs (worker/backend/link_run.h): the host goes down the tree, the device says what points
 * see. */
#ifndef KILN_WORKER_BACKEND_VULKAN_LINK_VIEWS_H
#define KILN_WORKER_BACKEND_VULKAN_LINK_VIEWS_H

#include "worker/backend/link_run.h"
#include "worker/backend/vulkan/vulkan.h"

/* Which links the batch's tile runs have: what is not kept is found; with a target, links that have not been judged are
 * opened as far as it asks. `gathered`: what the rays of the batch's points have met; `key`: vulkan_links_key. made[i]
 * is set where the i-th tile run of the batch has new links, whose rows are open and whose shading normals are not
 * known: one block for free(). After a lost device rays are traced again. */
int vulkan_find_links(struct vulkan_backend *b, const struct kiln_links_parameters *parameters,
                      const struct kiln_batch *batch, const struct kiln_point_result *gathered, uint64_t key,
                      struct kiln_kept_links **made, uint64_t *rays, struct kiln_error *error);

/* ---- what of the tree is on the device: links.c ---- */

/* A step comes in many batches, for which it stays there: whether it is the same, hashes say. That of the points and
 * their order in the tree: */
uint64_t vulkan_links_key(const struct vulkan_backend *b, const struct kiln_links_parameters *parameters);
bool vulkan_links_there(const struct vulkan_backend *b, int which, uint64_t key);
int vulkan_links_bring(struct vulkan_backend *b, int which, uint64_t key, const void *data, size_t bytes,
                       struct kiln_error *error);

#endif
