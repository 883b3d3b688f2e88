/* The guide of a tile run (worker/pass/guided.h): directions drawn by it, and what rays teach it. */
#ifndef KILN_WORKER_BACKEND_EMBREE_GUIDE_H
#define KILN_WORKER_BACKEND_EMBREE_GUIDE_H

#include <stdbool.h>
#include <stdint.h>

#include "shaders/shared/warp.h"
#include "worker/pass/guided.h"

enum { GUIDE_SIDE = KILN_GUIDE_SIDE_MOST, GUIDE_EDGES = GUIDE_SIDE + 1 };

/* A density over the unit square, constant in each of GUIDE_SIDE x GUIDE_SIDE cells; a coarser guide has equal ones. */
struct guide {
    float rows[GUIDE_EDGES], columns[GUIDE_SIDE * GUIDE_EDGES]; /* cumulative, of each row; from 0 to 1 */
    float weight[GUIDE_SIDE * GUIDE_SIDE];                      /* 1 / density */
};

/* Makes the density of side x side values that were learnt. False: the cosine is as good. */
bool guide_make(struct guide *guide, const float *learnt, uint32_t side);

/* Where x in (0, 1) falls among the intervals whose edges begin at `first`. No branch, so that compilers do this for
 * many lanes at once. */
_Static_assert((int)GUIDE_SIDE == 16, "four halvings");
static inline uint32_t guide_interval(const float *edges, uint32_t first, float x)
{
    uint32_t i = x >= edges[first + 8] ? 8u : 0u;
    i += x >= edges[first + i + 4] ? 4u : 0u;
    i += x >= edges[first + i + 2] ? 2u : 0u;
    return i + (x >= edges[first + i + 1] ? 1u : 0u);
}

static inline float guide_stretch(const float *edges, uint32_t first, uint32_t i, float x)
{
    const float low = edges[first + i], t = (x - low) / (edges[first + i + 1] - low);
    const float y = ((float)(int32_t)i + t) * (1.0f / GUIDE_SIDE);
    return y < 0x1.fffffep-1f ? y : 0x1.fffffep-1f;
}

/* Warps a point of the unit square that is uniform to one that has the density; returns 1 / density there. */
static inline float guide_warp(const struct guide *g, float *u, float *v)
{
    const uint32_t i = guide_interval(g->rows, 0, *u), row = i * GUIDE_EDGES, j = guide_interval(g->columns, row, *v);
    *u = guide_stretch(g->rows, 0, i, *u);
    *v = guide_stretch(g->columns, row, j, *v);
    return g->weight[i * GUIDE_SIDE + j];
}

/* Of side x side cells that in which such a point, given by fractions of 2^32, lies once it is warped. */
static inline uint32_t guide_cell(const struct guide *g, uint32_t side, uint32_t u, uint32_t v)
{
    const uint32_t i = guide_interval(g->rows, 0, kiln_unit_float(u)),
                   j = guide_interval(g->columns, i * GUIDE_EDGES, kiln_unit_float(v));
    return i * side / GUIDE_SIDE * side + j * side / GUIDE_SIDE;
}

#endif
