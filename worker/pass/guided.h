/* The guided pass: the gather pass (gather.h) with directions that earlier rays of the same tile run choose.
 *
 * A tile run has a *guide*: a grid over the unit square that is mapped to cosine-distributed directions (u: squared
 * sine of the angle to the axis, v: turn about it). Each cell has the root mean square of the luminance found by rays
 * in it, W/m2, summed over the bounces so far. Tile runs of 64 points have 16 x 16 cells, of 16 points and more 8 x 8;
 * smaller ones have none.
 *
 * `learns`: the results say what to add to the guide.
 *
 * `follows`: directions have the density q times that of the cosine, where q is constant in a cell:
 *
 *     q = 3/10 + 7/10 g / mean(g),       E = mean of B(hit) / q
 *
 * with g the guide, its squares smoothed twice over neighbours (4 : 1 : 1 : 1 : 1). This is the balance heuristic of
 * one sample for a mixture of cosine and guide (Veach and Guibas, "Optimally Combining Sampling Techniques for Monte
 * Carlo Rendering", SIGGRAPH 1995): no weight is above 10/3, and the mean is right whatever the guide. Samples are
 * warped by rows, then within rows, and stay stratified. If mean(g^2) is less than KILN_GUIDE_LEAST times mean(g)^2,
 * light comes from all directions and cosine sampling is as good: the tile run then uses exactly the rays of the gather
 * pass. The same holds for surfaces without `guide`, and if `follows` is false.
 *
 * Items: tile runs. Result: struct kiln_guided_result. Parameters: struct kiln_guided_parameters. Samples, streams,
 * rays: as the gather pass. Counts of rays (escaped, blocked, glass) are sums of 1 / q. With point masks only the
 * computed points contribute to `learnt`, which is stored in the results of all points. */
#ifndef KILN_WORKER_PASS_GUIDED_H
#define KILN_WORKER_PASS_GUIDED_H

#include "shaders/shared/guide.h"
#include "worker/pass/pass.h"
#include "worker/pass/point.h"

#define KILN_GUIDE_LEAST 2.0

struct kiln_guided_parameters {
    bool learns, follows;
};

struct kiln_guided_result {
    struct kiln_point_result point;
    /* additions to the tile run's guide by the rays of all its points: result i has cells KILN_GUIDE_FLOATS i and
     * following, in rows of u; 0 unless the pass learns */
    float learnt[KILN_GUIDE_FLOATS];
};

/* Cells along a side of the guide of a tile run with this number of points; 0: no guide. */
static inline uint32_t kiln_guide_side(uint32_t points)
{
    const uint32_t most = KILN_GUIDE_SIDE;
    if (points * KILN_GUIDE_FLOATS >= most * most)
        return most;
    return points * KILN_GUIDE_FLOATS >= most * most / 4 ? most / 2 : 0;
}

#endif
