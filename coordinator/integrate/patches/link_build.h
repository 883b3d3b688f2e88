/* Builds the nodes of a tree of links (link_tree.h), by all threads: the same for any number of them. Not collective.
 */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_BUILD_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_BUILD_H

#include "worker/base/arena.h"
#include "worker/pass/links.h"

/* Nodes `first` to `first + count`: a node and all below it. */
struct kiln_link_part {
    uint32_t first, count;
};

/* All nodes; a node's number is less than those of its children. Zero, or from kiln_link_build; release it. */
struct kiln_link_nodes {
    struct kiln_link_node *of;
    size_t count;
    /* every node is in one of these parts, or is over them: one that is over others comes before them in `over` */
    struct kiln_link_part *parts;
    uint32_t *over;
    size_t part_count, over_count;
    struct kiln_arena arena;
};

/* `points`: by global index; `first`: the first light of each over the mean; `rooms`: the room of each (link_rooms.h).
 * A node that has points of several rooms is too large to be taken by any. `order`: those that send light, by their
 * numbers; it is replaced by the tree's order, in which every node's points lie together. No nodes of less than two
 * points. KILN_SYSTEM: release the nodes then, too; the order is of no use. */
int kiln_link_build(const struct kiln_patch *points, const float *first, const uint32_t *rooms, uint32_t *order,
                    uint32_t count, struct kiln_link_nodes *nodes, struct kiln_error *error);
void kiln_link_nodes_release(struct kiln_link_nodes *nodes);

/* Most bytes of memory for so many points while nodes are built, besides the nodes that stay. */
uint64_t kiln_link_build_bytes(uint64_t points);

#endif
