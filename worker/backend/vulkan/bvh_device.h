/* BVH over the world's triangles, built on the device, and its layouts, also made there.
 *
 * Triangles are sorted along a Morton curve of 63 bits (a cube around the world, 2^21 steps a side) and merged
 * bottom-up by parallel locally-ordered clustering: Meister and Bittner, "Parallel locally-ordered clustering for
 * bounding volume hierarchy construction", IEEE TVCG 24 (2018), algorithm 1; Benthin et al., "PLOC++: parallel
 * locally-ordered clustering for bounding volume hierarchy construction revisited", PACM CGIT 5 (2022). In a round each
 * cluster finds, among BVH_RADIUS on either side along the curve, the one with which its box has the least surface;
 * pairs that find each other are merged. Ties go to the cluster whose place differs in the lowest bits, so that many
 * boxes in one place are halved in each round. If rounds still merge few, neighbours are merged as they are. When at
 * most KILN_BVH_TOP clusters are left, the host builds the top of the tree top-down (bvh_top.h), which makes traversal
 * faster. Subtrees of at most three triangles are leaves where the surface area heuristic says so (Goldsmith and Salmon
 * 1987, MacDonald and Booth 1990).
 *
 * Prefix sums assign all places, not the order in which threads arrive: one device always builds the same tree. Kernels
 * need no subgroups, and 5 KiB of a group's memory. Time is roughly proportional to the number of triangles: a sort of
 * 16 passes, some twenty rounds whose clusters dwindle by a third or more in each, and three passes over the nodes of a
 * layout.
 *
 * None of these is collective. Unless said otherwise functions return KILN_OK, KILN_NO_DEVICE or KILN_SYSTEM. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BVH_DEVICE_H
#define KILN_WORKER_BACKEND_VULKAN_BVH_DEVICE_H

#include "worker/backend/vulkan/bvh.h"
#include "worker/backend/vulkan/gpu/gpu.h"

struct bvh_device;

/* Least number of triangles for which a hardware device builds the tree. On an H200 device and host both take 0.02 s
 * for 100,000 (Embree on 16 idle cores), and 0.06 and 0.28 s for 4 million; with other load on these cores Embree took
 * up to 2.4 s. */
enum { BVH_DEVICE_LEAST = 1 << 16 };

/* Whether the device can build the tree: rays can hit something, there are no more triangles than a leaf can point at,
 * and there is memory: about 290 bytes a triangle, layout included. */
bool bvh_device_can(const struct gpu *gpu, const struct kiln_geometry *geometry);
/* Builds the tree of a geometry for which bvh_device_can is true. `threads`: of the host, 0: all. The gpu and the
 * geometry are borrowed and must outlive it. */
int bvh_device_create(struct bvh_device **tree, struct gpu *gpu, const struct kiln_geometry *geometry, uint32_t threads,
                      struct kiln_error *error);
void bvh_device_destroy(struct bvh_device **tree);

/* The four-wide layout on the device; its owner destroys the buffers. */
struct bvh_device_layout {
    struct gpu_buffer nodes, triangles;
    size_t node_count, triangle_count;
    uint32_t stack; /* maximum number of stack entries that traversal may need */
};
/* Finds whether traversal of the layout fits the stack of shaders. */
int bvh_device_fits(struct bvh_device *tree, bool *fits, struct kiln_error *error);
/* Makes the layout. *too_deep: traversal might overflow the stack of shaders; then no buffer is made, and
 * bvh_device_fetch gives a tree that is split evenly where it is too deep. */
int bvh_device_layout_create(struct bvh_device *tree, struct bvh_device_layout *layout, bool *too_deep,
                             struct kiln_error *error);
void bvh_device_layout_free(struct bvh_device_layout *layout, struct gpu *gpu);

/* Copies the tree to the host, for layouts that the device does not make. */
int bvh_device_fetch(struct bvh_device *tree, const struct bvh_params *params, struct bvh **bvh,
                     struct kiln_error *error);

#endif
