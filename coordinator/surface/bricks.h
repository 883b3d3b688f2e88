/* Bricks: finds the bricks (blocks of octree leaves, worker/scene/surface.h) that the triangles of an object reach. */
#ifndef KILN_COORDINATOR_SURFACE_BRICKS_H
#define KILN_COORDINATOR_SURFACE_BRICKS_H

#include "coordinator/surface/build.h"

/* Calls visit(context, place) for each brick that a world triangle reaches, with the brick's place (kiln_brick_place).
 * Conservative: it may visit bricks that the triangle just misses. A triangle without area reaches none. */
void kiln_bricks_of(const struct kiln_geometry *geometry, uint32_t triangle,
                    void (*visit)(void *context, uint64_t place), void *context);

/* Finds the bricks of all octrees: fills bricks, slots, tile_count and the lightmaps' tiles. Not collective: every rank
 * finds all of them. The time is O(n log n) in the bricks of each octree. KILN_BAD_INPUT for 2^29 bricks or more in one
 * octree, or 2^32 in all; KILN_SYSTEM. `has_backs` says whether an object's backs have octrees. */
int kiln_bricks_find(struct kiln_build *build, bool (*has_backs)(const struct kiln_build *build, size_t object));

#endif
