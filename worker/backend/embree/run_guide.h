/* Guide of a tile run (worker/pass/guided.h): distributes its rays, and is learnt from their findings. */
#ifndef KILN_WORKER_BACKEND_EMBREE_RUN_GUIDE_H
#define KILN_WORKER_BACKEND_EMBREE_RUN_GUIDE_H

#include "shaders/shared/warp.h"
#include "worker/backend/embree/rays.h"
#include "worker/backend/guide.h"
#include "worker/pass/guided.h"

struct run_guide {
    uint32_t side;                                    /* cells along a side of the guide being learnt; 0: none */
    uint32_t shift;                                   /* right shift from a random number to a cell's place */
    double square[KILN_GUIDE_SIDE * KILN_GUIDE_SIDE]; /* sum of squared luminances found in each cell */
    float guide[KILN_GUIDE_SIZE];                     /* the guide that distributes rays */
};

/* Sets how the tile run's rays use the guide; after rays_begin. */
void run_guide_begin(struct run_guide *guide, struct tile_run_rays *rays, const struct embree_backend *b,
                     const struct kiln_guided_parameters *parameters, size_t tile_run);
/* Writes the learnt root mean squares, normalised as if each cell had had its share of cosine-distributed rays. */
void run_guide_store(const struct run_guide *guide, const struct tile_run_rays *rays,
                     struct kiln_guided_result *results);

/* Adds the luminance, with its weight, that the ray of lane l has found; divides out the density by which its cell was
 * sampled. */
static inline void run_guide_learn(struct run_guide *g, const struct tile_run_rays *r, uint32_t step, uint32_t l,
                                   float luminance)
{
    const uint32_t k = step * r->copies + r->copy[l], u = r->scrambled[0][k] ^ r->shift_u[l],
                   v = r->scrambled[1][k] ^ r->shift_v[l];
    const uint32_t cell =
        r->guide != NULL ? kiln_guide_cell(r->guide, g->side, u, v) : (u >> g->shift) * g->side + (v >> g->shift);
    g->square[cell] += (double)luminance * (double)luminance / (double)r->weight[l];
}

#endif
