/* Blocks: bounces at a part of the resolution (--indirect-scale K). In a bounce one point of each block gathers, and
 * all points of the block take its answer: Vandersanden 2023, section 4.7.2, proposes it.
 *
 * A block has alike points of one tile, K x K texels at most: where a tile is full, the squares that it falls into. It
 * begins with the first point, in Morton order, that is in no block yet. A point is alike that one if
 *
 *   - their normals are no more than 25 degrees apart,
 *   - it lies no farther away than the texels between them are wide, so that both are of one chart, or of charts that
 *     go on into each other,
 *   - a ray between them, a quarter of a texel above the surface, meets nothing: no wall stands between them, and no
 * step that is higher.
 *
 * A point that has something less than half a texel above it is a block of its own, for light changes fast there; so is
 * one that is partly there (a texture with holes). A block never lies in two tiles, and with K > 1 cells cut no tile
 * (struct kiln_surface_params): blocks are the same for any ranks and cells.
 *
 * A block of a quarter of K x K points or less takes an eighth of the samples (kiln_batch_few): for each of its texels
 * half of what a full block has, or more. Else small blocks, which have little weight in what others gather, would have
 * most of the rays.
 *
 * Which of a block's points gathers changes from bounce to bounce, so that each has its turn: over n bounces a rotated
 * van der Corput sequence spreads the n choices evenly over the block. It is a function of the seed, the tile, the
 * block, the step's stream and its part. Each answer is right for its own point and not for the others: bounces lose
 * detail within a block, and the direct light and the final gather, which every point has of its own, do not. */
#ifndef KILN_COORDINATOR_INTEGRATE_SPARSE_BLOCKS_H
#define KILN_COORDINATOR_INTEGRATE_SPARSE_BLOCKS_H

#include "coordinator/integrate/sparse/sparse.h"

/* Finds the blocks of all points of the surface: block[i] is the place, within its tile run, of the first point of the
 * block that own point i is of. `links`: NULL, or 1 an own point; that of a block's first point says which blocks of
 * its tile run go on from it (nodes.h): bit k, the one whose first point is the k-th. `scale`: 1 to KILN_TILE_SIDE, a
 * power of two. `backend` traces; it need not have the surface, whose validity is known. Not collective. KILN_SYSTEM,
 * KILN_NO_DEVICE. */
int kiln_blocks_find(const struct kiln_surface *surface, struct kiln_backend *backend, uint32_t threads, uint32_t scale,
                     uint16_t *block, uint64_t *links, struct kiln_error *error);

/* Writes at each block's first point, in a tile run, the place of its point farthest from the tile's middle. `block` is
 * that of the tile run's first point. */
void kiln_block_corners(const struct kiln_tile_run *tile_run, const uint16_t *block, uint8_t corner[KILN_TILE_TEXELS]);

/* Which points of a tile run gather in a step, and whose answer each takes. `block` is that of the tile run's first
 * point; `scale` as for kiln_blocks_find. Pure. */
void kiln_blocks_draw(struct kiln_sparse *sparse, const struct kiln_surface *surface,
                      const struct kiln_tile_run *tile_run, const uint16_t *block, uint32_t scale, uint64_t seed,
                      const struct kiln_step *step);

#endif
