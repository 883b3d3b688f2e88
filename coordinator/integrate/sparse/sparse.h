/* Sparse steps: a part of the points is computed, and the others get their light from these. One description serves
 * bounces in blocks (blocks.h: a point takes its block's answer) and the final gather of nodes (nodes.h: a point mixes
 * the answers of four nodes at most): which points of a tile run are computed, which of them with fewer samples, and
 * what each point mixes. By it the companions "blocks" and "nodes" select points, and integrators take answers. */
#ifndef KILN_COORDINATOR_INTEGRATE_SPARSE_SPARSE_H
#define KILN_COORDINATOR_INTEGRATE_SPARSE_SPARSE_H

#include "coordinator/integrate/companion.h"

enum { KILN_MIXED_MOST = 4 };

/* Computed points whose answers a point mixes: places within its tile run, with weights of sum 1. Computed are all of
 * them that are valid. */
struct kiln_mixture {
    uint32_t count;
    uint8_t place[KILN_MIXED_MOST];
    double weight[KILN_MIXED_MOST];
};

/* A tile run in a step. */
struct kiln_sparse {
    struct kiln_selection selection;               /* none that is not valid */
    struct kiln_mixture mixture[KILN_TILE_TEXELS]; /* of its k-th point; a computed one has its own answer */
};

/* Whether a step is sparse. */
static inline bool kiln_step_is_sparse(const struct kiln_step *step)
{
    return kiln_step_has(step, KILN_WITH(blocks) | KILN_WITH(nodes));
}

/* Fills in what a sparse step is for tile run `tile_run` of `data`. Pure. */
void kiln_sparse_find(struct kiln_sparse *sparse, const struct kiln_integrate_settings *settings,
                      const struct kiln_step *step, const struct kiln_rank_data *data, size_t tile_run);

#endif
