/* Builds the top of a BVH over given subtrees (clusters), top-down by the surface area heuristic, with a full sweep
 * along each axis (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007, section 2). All threads
 * take part; the tree is the same for any number of threads. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BVH_TOP_H
#define KILN_WORKER_BACKEND_VULKAN_BVH_TOP_H

#include "worker/base/status.h"
#include "shaders/shared/push.h"

/* Input and output of bvh_top_build, all borrowed. Boxes in metres. */
struct bvh_top {
    const struct kiln_gpu_bvh_node *clusters;    /* `count`, at least one: boxes */
    const struct kiln_gpu_bvh_subtree *subtrees; /* statistics of each cluster's subtree */
    const uint32_t *names;                       /* node numbers of the clusters */
    uint32_t count;
    uint32_t first; /* number of the first new node */
    float inverse_extent;
    uint32_t threads; /* 0: all of the machine's cores that this process may use */
    /* the new nodes, count - 1, children before their parents, the root last */
    struct kiln_gpu_bvh_node *nodes;
    struct kiln_gpu_bvh_subtree *node_subtrees;
};
/* Not collective. KILN_SYSTEM when memory runs out. */
int bvh_top_build(const struct bvh_top *top, struct kiln_error *error);

#endif
