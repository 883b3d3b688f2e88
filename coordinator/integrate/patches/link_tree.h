/* The tree whose nodes the links pass gathers from (worker/pass/links.h): over all surface points that send light.
 *
 * A range of points is cut in two where it is longest, in six dimensions: those of its box, and those of its normals'
 * box, each times the length of the diagonal of the first. So what looks another way comes apart before what lies
 * elsewhere: a room ends as its walls, a wall as squares of texels, and far houses as their sides that look one way. It
 * is cut in the middle, or, where one half would have less than an eighth of the points, so that both have as many.
 * Each half is cut again, and the four are the node's children. Up to four points are children themselves.
 *
 * The tree hangs on patches, their numbers and first light alone, so it is the same for any cells and ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_TREE_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_TREE_H

#include "worker/pass/links.h"

struct kiln_link_tree;

/* `points`: of all surface points, by global index, and `rooms`, the room of each (link_rooms.h); borrowed. `light`:
 * the first light of each, any unit; read by this call alone. KILN_SYSTEM. */
int kiln_link_tree_create(struct kiln_link_tree **tree, const struct kiln_patch *points, const uint32_t *rooms,
                          const float *light, uint64_t count, struct kiln_error *error);
/* NULL is accepted. */
void kiln_link_tree_destroy(struct kiln_link_tree **tree);

/* Most bytes of memory for so many points. */
uint64_t kiln_link_tree_bytes(uint64_t points);

/* Radiosity of a point, W/m2. Called by several threads. */
typedef void (*kiln_link_of_point)(const void *context, uint64_t point, float radiosity[3]);
/* Takes the radiosity of all points in a bounce, and finds that of the nodes. What was sent in earlier bounces, which
 * has gone by the same links and so is off the same way, is taken for the first light, and, of bounces from the second
 * on, for what this one sends: those were brighter, but few know it after an interruption. */
void kiln_link_tree_set_light(struct kiln_link_tree *tree, uint32_t bounce, kiln_link_of_point light,
                              const void *context);

/* Fills in the tree's part of the parameters; borrowed. */
void kiln_link_tree_describe(const struct kiln_link_tree *tree, struct kiln_links_parameters *parameters);

#endif
