/* Edge tree: finds the edges near a given edge. It is a bounding volume hierarchy of axis-parallel boxes with four
 * children per node; the edges are in the order of a space-filling curve. An empty box has its low corner above its
 * high one. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_EDGE_TREE_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_EDGE_TREE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

struct kiln_box {
    float low[3], high[3];
};

struct kiln_box kiln_box_empty(void);
bool kiln_box_is_empty(const struct kiln_box *box);
void kiln_box_add(struct kiln_box *box, const float point[3]);
void kiln_box_join(struct kiln_box *box, const struct kiln_box *other);
struct kiln_box kiln_box_common(const struct kiln_box *a, const struct kiln_box *b);
/* Moves the sides of a box that is not empty outward. */
void kiln_box_widen(struct kiln_box *box, float by);

struct kiln_edge {
    float end[2][3];
};

struct kiln_edge_tree;

/* Builds the tree over at least one edge and fewer than 2^32. The edges are borrowed. Not collective. */
int kiln_edge_tree_create(struct kiln_edge_tree **tree, const struct kiln_edge *edges, size_t count,
                          struct kiln_error *error);
void kiln_edge_tree_destroy(struct kiln_edge_tree **tree);

/* Calls visit(context, number) for every edge whose box comes as near as `gap` to that of `edge`. Thread-safe. */
void kiln_edge_tree_visit(const struct kiln_edge_tree *tree, const struct kiln_edge *edge, float gap,
                          void (*visit)(void *context, size_t number), void *context);

#endif
