/* The guided pass: the gather pass (gather.h) with directions that earlier rays of the same tile run choose.
 *
 * A tile run has a *guide*: a grid over the unit square that cosine-distributed directions are made of (u: square of
 * the sine to the axis, v: turn about it), and for each of its cells the root mean square of the luminance that rays of
 * the bounces have found there, W/m2, each bounce's added. Tile runs of 64 points have 16 x 16 cells, of 16 points and
 * more 8 x 8; smaller ones have none.
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
 * warped by rows, then within rows, and stay stratified. Where mean(g^2) is less than KILN_GUIDE_LEAST times mean(g)^2,
 * light comes from all over and the cosine is as good: such a tile run has the very rays and results of the gather
 * pass. So has every tile run of a surface without `guide`, and of a pass that does not follow.
 *
 * Items: tile runs. Result: struct kiln_guided_result. Parameters: struct
 * kiln_guided_parameters. Samples, streams, rays: as the gather pass. Counts of rays (escaped, blocked, glass) are sums
 * of 1 / q. With point masks what is learnt is of the points that are computed, and stands in the results of all. */
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
    /* what the rays of the whole tile run add to its guide: the i-th point has cells KILN_GUIDE_FLOATS i and after, in
     * rows of u; 0 unless the pass learns */
    float learnt[KILN_GUIDE_FLOATS];
};

/* Cells along a side of the guide of a tile run of so many points; 0: it has none. */
static inline uint32_t kiln_guide_side(uint32_t points)
{
    const uint32_t most = KILN_GUIDE_SIDE;
    if (points * KILN_GUIDE_FLOATS >= most * most)
        return most;
    return points * KILN_GUIDE_FLOATS >= most * most / 4 ? most / 2 : 0;
}

#endif
