/* The guide of a tile run (worker/pass/guided.h): directions drawn by it, and what rays teach it. */
#ifndef KILN_WORKER_BACKEND_EMBREE_GUIDE_H
#define KILN_WORKER_BACKEND_EMBREE_GUIDE_H

#include <stdbool.h>
#include <stdint.h>

#include "shaders/shared/warp.h"
#include "worker/pass/guided.h"

/* A density over the unit square, constant in each of side x side cells. */
struct guide {
    uint32_t side; /* a power of two */
    float rows[KILN_GUIDE_SIDE_MOST + 1];
    float columns[KILN_GUIDE_SIDE_MOST][KILN_GUIDE_SIDE_MOST + 1]; /* cumulative; from 0 to 1 */
    float weight[KILN_GUIDE_SIDE_MOST][KILN_GUIDE_SIDE_MOST];      /* 1 / density */
};

/* Makes the density of side x side values that were learnt. False: the cosine is as good. */
bool guide_make(struct guide *guide, const float *learnt, uint32_t side);

/* Where x in (0, 1) falls among `side` intervals. */
static inline uint32_t guide_interval(const float *cumulative, uint32_t side, float x)
{
    uint32_t i = 0;
    for (uint32_t half = side / 2; half > 0; half /= 2)
        i += x >= cumulative[i + half] ? half : 0;
    return i;
}

static inline float guide_stretch(const float *cumulative, uint32_t side, uint32_t i, float x)
{
    const float t = (x - cumulative[i]) / (cumulative[i + 1] - cumulative[i]), y = ((float)i + t) / (float)side;
    return y < 0x1.fffffep-1f ? y : 0x1.fffffep-1f;
}

/* The cell of a point of the unit square, given by fractions of 2^32, once it is warped. */
static inline uint32_t guide_cell(const struct guide *g, uint32_t u, uint32_t v)
{
    const uint32_t i = guide_interval(g->rows, g->side, kiln_unit_float(u));
    return i * g->side + guide_interval(g->columns[i], g->side, kiln_unit_float(v));
}

/* Warps a point of the unit square that is uniform to one that has the density; returns 1 / density there. */
static inline float guide_warp(const struct guide *g, float *u, float *v)
{
    const uint32_t i = guide_interval(g->rows, g->side, *u), j = guide_interval(g->columns[i], g->side, *v);
    *u = guide_stretch(g->rows, g->side, i, *u);
    *v = guide_stretch(g->columns[i], g->side, j, *v);
    return g->weight[i][j];
}

#endif
