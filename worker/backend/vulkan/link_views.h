/* Finding the links of tile runs (worker/backend/link_run.h): the host descends the tree, the device traces visibility.
 */
#ifndef KILN_WORKER_BACKEND_VULKAN_LINK_VIEWS_H
#define KILN_WORKER_BACKEND_VULKAN_LINK_VIEWS_H

#include "worker/backend/link_run.h"
#include "worker/backend/vulkan/vulkan.h"

/* Finds the links of the batch's tile runs that are not kept. With a target, it opens links that were not yet judged as
 * far as the target requires. `gathered`: results of the rays of the batch's points; `key`: vulkan_links_key. made[i]
 * is set if the i-th tile run of the batch has new links, whose rows are open and whose shading normals are unknown:
 * one block for free(). After the loss of a device rays are traced again. */
int vulkan_find_links(struct vulkan_backend *b, const struct kiln_links_parameters *parameters,
                      const struct kiln_batch *batch, const struct kiln_point_result *gathered, uint64_t key,
                      struct kiln_kept_links **made, uint64_t *rays, struct kiln_error *error);

/* ---- the link tree on the device: links.c ---- */

/* The tree stays on the device for the many batches of a step; hashes tell whether it is still valid. vulkan_links_key
 * is the hash of the points and their order in the tree, vulkan_links_there compares, vulkan_links_bring uploads. */
uint64_t vulkan_links_key(const struct vulkan_backend *b, const struct kiln_links_parameters *parameters);
bool vulkan_links_there(const struct vulkan_backend *b, int which, uint64_t key);
int vulkan_links_bring(struct vulkan_backend *b, int which, uint64_t key, const void *data, size_t bytes,
                       struct kiln_error *error);

#endif
