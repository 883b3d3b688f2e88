/* Tree of links: the nodes from which the links pass gathers (worker/pass/links.h), over all surface points that send
 * light.
 *
 * A range of points is cut in two along the longest of six dimensions: three of its bounding box, and three of the box
 * of its normals, scaled by the first box's diagonal. So points separate by orientation before they separate by
 * position: a room becomes walls, a wall squares of texels, and far houses their sides of one orientation. The cut is
 * in the middle or, if one half would have less than an eighth of the points, at the median. Each half is cut again,
 * which gives four children. Up to four points become children themselves.
 *
 * The tree depends only on patches, their numbers and first light: the same for any cells and ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_TREE_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_TREE_H

#include "worker/pass/links.h"

struct kiln_link_tree;

/* `points` and `rooms` (link_rooms.h) of all surface points, by global index, are borrowed. `light`: each point's first
 * light, any unit; read by this call alone. KILN_SYSTEM. */
int kiln_link_tree_create(struct kiln_link_tree **tree, const struct kiln_patch *points, const uint32_t *rooms,
                          const float *light, uint64_t count, struct kiln_error *error);
/* NULL is accepted. */
void kiln_link_tree_destroy(struct kiln_link_tree **tree);

/* Upper bound of the memory, bytes, for `points` points. */
uint64_t kiln_link_tree_bytes(uint64_t points);

/* Radiosity of a point, W/m2. Called by several threads. */
typedef void (*kiln_link_of_point)(const void *context, uint64_t point, float radiosity[3]);
/* Sets the radiosity of all points in a bounce and computes that of the nodes. Light of earlier bounces passed through
 * the same links, with the same errors. As its estimate stands the first light and, from the second bounce on, this
 * bounce's light: the true earlier bounces were brighter, but are mostly unknown after an interruption. */
void kiln_link_tree_set_light(struct kiln_link_tree *tree, uint32_t bounce, kiln_link_of_point light,
                              const void *context);

/* Fills in the tree's part of the parameters; borrowed. */
void kiln_link_tree_describe(const struct kiln_link_tree *tree, struct kiln_links_parameters *parameters);

#endif
