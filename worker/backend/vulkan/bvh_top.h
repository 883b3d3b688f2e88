/* The top of a tree whose lower parts are there: joins clusters from above by the surface area heuristic, with a full
 * sweep along each axis (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007, section 2). By
 * all threads; the same tree on any number of them. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BVH_TOP_H
#define KILN_WORKER_BACKEND_VULKAN_BVH_TOP_H

#include "worker/base/status.h"
#include "shaders/shared/push.h"

/* All is borrowed. Boxes in metres. */
struct bvh_top {
    const struct kiln_gpu_bvh_node *clusters; /* `count`, at least one: boxes */
    const struct kiln_gpu_bvh_share *shares;  /* what is below each */
    const uint32_t *names;                    /* their numbers as nodes */
    uint32_t count;
    uint32_t first; /* number of the first node that is made */
    float inverse_extent;
    uint32_t threads; /* 0: all of the machine's cores that this process may use */
    /* the nodes that are made, count - 1, children before their parents, the root last */
    struct kiln_gpu_bvh_node *nodes;
    struct kiln_gpu_bvh_share *node_shares;
};
/* Not collective. KILN_SYSTEM when memory runs out. */
int bvh_top_build(const struct bvh_top *top, struct kiln_error *error);

#endif
