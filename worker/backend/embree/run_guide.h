/* The guide of a tile run (worker/pass/guided.h): followed by its rays, and learnt from what they find. */
#ifndef KILN_WORKER_BACKEND_EMBREE_RUN_GUIDE_H
#define KILN_WORKER_BACKEND_EMBREE_RUN_GUIDE_H

#include "shaders/shared/warp.h"
#include "worker/backend/embree/rays.h"
#include "worker/backend/guide.h"
#include "worker/pass/guided.h"

struct run_guide {
    uint32_t side;  /* cells along a side of the guide that is learnt; 0: none is */
    uint32_t shift; /* by how much random numbers are shifted right to have a cell's place */
    double square[KILN_GUIDE_SIDE * KILN_GUIDE_SIDE]; /* luminance that was found in each cell, squared and summed up */
    float guide[KILN_GUIDE_SIZE];                     /* that is followed */
};

/* After rays_begin of the tile run: sets what its rays do with the guide. */
void run_guide_begin(struct run_guide *guide, struct tile_run_rays *rays, const struct embree_backend *b,
                     const struct kiln_guided_parameters *parameters, size_t tile_run);
/* Writes what was learnt: root mean squares, as if each cell had had its share of rays by the cosine. */
void run_guide_store(const struct run_guide *guide, const struct tile_run_rays *rays,
                     struct kiln_guided_result *results);

/* The ray of lane l has found so much light, its weight in it: its cell has had rays by its density. */
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
