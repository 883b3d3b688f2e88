/* Blocks: groups of points that share one gather in bounces, which thus run at a fraction of the resolution
 * (--indirect-scale K). One point of each block gathers, and all points of the block take its answer, as Vandersanden
 * 2023, section 4.7.2, proposes.
 *
 * A block has similar points of one tile, at most K x K texels; in a full tile blocks are squares. A block begins with
 * the first point, in Morton order, that is in no block yet. Another point is similar to that one if
 *
 *   - their normals are no more than 25 degrees apart,
 * - its distance is at most the width of the texels between them, so that both are of one chart, or of charts that
 * continue each other,
 * - a ray between them, a quarter of a texel above the surface, is unobstructed by walls or higher steps.
 *
 * Two kinds of points are blocks of their own: those with an obstacle less than half a texel above, where light changes
 * fast, and those only partly present (a texture with holes). A block never spans two tiles, and with K > 1 cells do
 * not cut tiles (struct kiln_surface_params): blocks are the same for any ranks and cells.
 *
 * A block of at most a quarter of K x K points takes an eighth of the samples (kiln_batch_few): per texel still at
 * least half of those of a full block. Otherwise small blocks, which weigh little in the light that others gather,
 * would take most of the rays.
 *
 * The gathering point of a block changes from bounce to bounce: over n bounces a rotated van der Corput sequence
 * spreads the n choices evenly over the block. It depends on the seed, the tile, the block, the step's stream and its
 * part. Each answer is exact only for its own point: bounces lose detail within a block, but direct light and the final
 * gather, computed for every point, do not. */
#ifndef KILN_COORDINATOR_INTEGRATE_SPARSE_BLOCKS_H
#define KILN_COORDINATOR_INTEGRATE_SPARSE_BLOCKS_H

#include "coordinator/integrate/sparse/sparse.h"

/* Finds the blocks of all points of the surface: block[i] is the place, within its tile run, of the first point of the
 * block of own point i. `links`: NULL, or one word per own point; the word of a block's first point tells the blocks of
 * its tile run that continue it (nodes.h): bit k, the block whose first point is the k-th. `scale`: 1 to
 * KILN_TILE_SIDE, a power of two. `backend` traces; it does not need the surface, whose validity is known. Not
 * collective. KILN_SYSTEM, KILN_NO_DEVICE. */
int kiln_blocks_find(const struct kiln_surface *surface, struct kiln_backend *backend, uint32_t threads, uint32_t scale,
                     uint16_t *block, uint64_t *links, struct kiln_error *error);

/* For each block of a tile run, writes at its first point the place of its point farthest from the tile's middle.
 * `block` begins with the tile run's first point. */
void kiln_block_corners(const struct kiln_tile_run *tile_run, const uint16_t *block, uint8_t corner[KILN_TILE_TEXELS]);

/* Chooses the points of a tile run that gather in a step, and the point whose answer each takes. `block` is that of the
 * tile run's first point; `scale` as for kiln_blocks_find. Pure. */
void kiln_blocks_draw(struct kiln_sparse *sparse, const struct kiln_surface *surface,
                      const struct kiln_tile_run *tile_run, const uint16_t *block, uint32_t scale, uint64_t seed,
                      const struct kiln_step *step);

#endif
