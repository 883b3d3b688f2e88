/* A tree of boxes over the world's triangles, built on the device, and layouts of it, made there too.
 *
 * Triangles are sorted along a Morton curve of 63 bits (a cube around the world, 2^21 steps a side) and joined from
 * below by parallel locally-ordered clustering: Meister and Bittner, "Parallel locally-ordered clustering for bounding
 * volume hierarchy construction", IEEE TVCG 24 (2018), algorithm 1; Benthin et al., "PLOC++: parallel locally-ordered
 * clustering for bounding volume hierarchy construction revisited", PACM CGIT 5 (2022). In a round each cluster finds,
 * among BVH_RADIUS on either side along the curve, the one with which its box has the least surface; pairs that find
 * each other are joined. Among equals it is the one whose place differs in the lowest bits, so that of many boxes in
 * one place half go in each round; where rounds still join few, neighbours are joined as they stand. When no more than
 * KILN_BVH_TOP clusters are left, the host joins them from above (bvh_top.h), which rays are quicker through. Subtrees
 * of at most three triangles are leaves where the surface area heuristic says so (Goldsmith and Salmon 1987, MacDonald
 * and Booth 1990).
 *
 * Everything has its place by sums, not by the order in which threads come: one device always builds the same tree.
 * Kernels ask for no subgroups, and for 5 KiB of a group's memory. Time is about proportional to triangles: a sort of
 * 16 passes, some twenty rounds whose clusters dwindle by a third or more in each, and three looks at each node of a
 * layout.
 *
 * None of these is collective. Unless said otherwise functions return KILN_OK, KILN_NO_DEVICE or KILN_SYSTEM. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BVH_DEVICE_H
#define KILN_WORKER_BACKEND_VULKAN_BVH_DEVICE_H

#include "worker/backend/vulkan/bvh.h"
#include "worker/backend/vulkan/gpu/gpu.h"

struct bvh_device;

/* Triangles from which on a real device builds the tree. On an H200 both take 0.02 s for 100,000 (Embree on 16 idle
 * cores), and 0.06 and 0.28 s for 4 million; but where others are at work on these cores Embree took up to 2.4 s. */
enum { BVH_DEVICE_LEAST = 1 << 16 };

/* Whether rays can hit anything, no more than a leaf can point at, and the device has room to build: about 290 bytes a
 * triangle, layout included. */
bool bvh_device_can(const struct gpu *gpu, const struct kiln_geometry *geometry);
/* Builds the tree of a geometry of which bvh_device_can holds; `threads` of the host, 0: all that there are. The gpu
 * and the geometry are borrowed and must outlive it. */
int bvh_device_create(struct bvh_device **tree, struct gpu *gpu, const struct kiln_geometry *geometry, uint32_t threads,
                      struct kiln_error *error);
void bvh_device_destroy(struct bvh_device **tree);

/* The four-wide layout on the device; whoever asks for it destroys the buffers. */
struct bvh_device_layout {
    struct gpu_buffer nodes, triangles;
    size_t node_count, triangle_count;
    uint32_t stack; /* entries that a walk may need at most */
};
/* Whether no walk of it needs a deeper stack than shaders have. */
int bvh_device_fits(struct bvh_device *tree, bool *fits, struct kiln_error *error);
/* Makes it. *too_deep: a walk might need a deeper stack than shaders have; then no buffer is made, and
 * bvh_device_fetch has a tree that is cut evenly where it is too deep. */
int bvh_device_layout_create(struct bvh_device *tree, struct bvh_device_layout *layout, bool *too_deep,
                             struct kiln_error *error);
void bvh_device_layout_free(struct bvh_device_layout *layout, struct gpu *gpu);

/* The same tree for the host, for layouts that the device does not make. */
int bvh_device_fetch(struct bvh_device *tree, const struct bvh_params *params, struct bvh **bvh,
                     struct kiln_error *error);

#endif
