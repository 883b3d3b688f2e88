/* Builds the nodes of a tree of links (link_tree.h) with all threads; their number does not change the tree. Not
 * collective. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_BUILD_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_BUILD_H

#include "worker/base/arena.h"
#include "worker/pass/links.h"

/* A subtree: nodes `first` to `first + count`, a node and all its descendants. */
struct kiln_link_subtree {
    uint32_t first, count;
};

/* All nodes of the tree; a node has a smaller number than its children. Zero, or from kiln_link_build; release it. */
struct kiln_link_nodes {
    struct kiln_link_node *of;
    size_t count;
    /* each node either is in one of these subtrees or is an ancestor of some; `over` lists the ancestors, parents
     * first */
    struct kiln_link_subtree *parts;
    uint32_t *over;
    size_t part_count, over_count;
    struct kiln_arena arena;
};

/* `points`, `first` and `rooms` are indexed by global point number: patches, first light over the mean, and room
 * (link_rooms.h). A node with points of several rooms gets a size too large for any link. `order`: the points that send
 * light, by number; on return in tree order, where each node's points are contiguous. No node has less than two points.
 * KILN_SYSTEM: release the nodes then, too; the order is of no use. */
int kiln_link_build(const struct kiln_patch *points, const float *first, const uint32_t *rooms, uint32_t *order,
                    uint32_t count, struct kiln_link_nodes *nodes, struct kiln_error *error);
void kiln_link_nodes_release(struct kiln_link_nodes *nodes);

/* Upper bound of the memory, bytes, for building nodes of `points` points, without the nodes themselves. */
uint64_t kiln_link_build_bytes(uint64_t points);

#endif
