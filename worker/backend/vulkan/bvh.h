/* BVH over the world's triangles on the host, built by Embree (rtcBuildBVH) or taken from the device (bvh_device.h),
 * and the layouts in which kernels traverse it (described in shaders/shared/layout_trace.h).
 *
 * Any triangles are accepted: none, degenerate ones, many in one place. Boxes have a margin for the rounding errors of
 * tracing (KILN_GPU_BOX_MARGIN). None of these is collective. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BVH_H
#define KILN_WORKER_BACKEND_VULKAN_BVH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/scene/geometry.h"
#include "shaders/shared/push.h"

struct bvh;

/* Zero means default in every field. */
struct bvh_params {
    uint32_t threads;     /* of the build and of layouts; 0: all of the machine's cores that this process may use */
    uint32_t depth_limit; /* below this depth, or a smaller one if traversal would overflow its stack, subtrees are
                           * split in equal halves; 0: 40 */
};

/* Builds the tree. The geometry is borrowed and must outlive it. KILN_SYSTEM when memory runs out, KILN_BAD_INPUT
 * beyond 2^29 triangles (more than a leaf can point at). Memory while it lasts: about 40 bytes a triangle; four times
 * that while it is built. */
int bvh_create(struct bvh **bvh, const struct kiln_geometry *geometry, const struct bvh_params *params,
               struct kiln_error *error);
/* Makes the tree from that of bvh_device.h, with at least one triangle that rays can hit: it has twice as many nodes as
 * triangles, less one. */
int bvh_create_of(struct bvh **bvh, const struct kiln_geometry *geometry, const struct bvh_params *params,
                  const struct kiln_gpu_bvh_node *nodes, const struct kiln_gpu_bvh_subtree *subtrees,
                  struct kiln_error *error);
bool bvh_is_of_device(const struct bvh *bvh);
void bvh_destroy(struct bvh **bvh);

/* Returns the margin of boxes on each side of their contents, m. */
float bvh_margin(const struct kiln_geometry *g);

/* A layout in plain memory, ready to be uploaded as it is. */
struct bvh_layout {
    void *nodes; /* node_count of node_size bytes */
    size_t node_count, node_size;
    struct kiln_gpu_triangle *triangles; /* in the order of leaves; at least one */
    size_t triangle_count;
    uint32_t stack; /* stack entries that traversal may need, at most those that shaders have */
};
/* Exports one layout: KILN_TRAVERSAL_FOUR or KILN_TRAVERSAL_EIGHT. Free with bvh_layout_free. */
int bvh_layout_create(struct bvh_layout *layout, const struct bvh *bvh, uint32_t traversal, struct kiln_error *error);
void bvh_layout_free(struct bvh_layout *layout);

#endif
