/* How points see nodes: what finding links (link_find.c) and adding them up (link_sums.c) share. */
#ifndef KILN_WORKER_BACKEND_LINK_VIEW_H
#define KILN_WORKER_BACKEND_LINK_VIEW_H

#include <math.h>

#include "worker/backend/link_run.h"
#include "worker/sampling/keys.h"

#define KILN_LINKS_FLAT_NODE 0.1 /* bend of nodes that count as flat */
#define KILN_LINKS_RECTANGLE                                                                                           \
    3.1 /* the square of how far a rectangle's sides are, in standard deviations: 3, and rounding */

enum { KILN_LINK_DRAWS = 4 };

/* How a point sees a node. */
struct kiln_node_view {
    struct kiln_dvec3 d;
    double square, distance, other; /* other: -d about the node's normal */
    double height, reach;           /* the highest that it may stand over the point's horizon; and the point over its */
    bool whole;                     /* all of it is above the horizon and faces the point */
};

/* The covariance of the node's surface times a vector. */
static inline struct kiln_dvec3 kiln_link_covariance_times(const struct kiln_link_node *node, struct kiln_dvec3 v)
{
    const float *c = node->covariance;
    return dvec3((double)c[0] * v.x + (double)c[3] * v.y + (double)c[4] * v.z,
                 (double)c[3] * v.x + (double)c[1] * v.y + (double)c[5] * v.z,
                 (double)c[4] * v.x + (double)c[5] * v.y + (double)c[2] * v.z);
}

/* Whether a node whose centre stands so high over a plane with this normal lies above it: as a ball, or, where it is
 * flat, as the rectangle that has its covariance. */
static inline bool kiln_link_is_above(const struct kiln_link_node *node, struct kiln_dvec3 n, double height)
{
    const double radius = (double)node->radius;
    if (height >= radius || height <= 0.0)
        return height >= radius;
    return node->bend < KILN_LINKS_FLAT_NODE &&
           height * height >= KILN_LINKS_RECTANGLE * dvec3_dot(n, kiln_link_covariance_times(node, n));
}

static inline struct kiln_node_view kiln_link_view_of(const struct kiln_link_run *w, uint32_t bit,
                                                      const struct kiln_link_node *node)
{
    const struct kiln_dvec3 n = w->receiver[bit].n, d = dvec3_sub(dvec3_of(node->centre), w->at[bit]);
    struct kiln_node_view v = {.d = d, .square = dvec3_dot(d, d), .other = -dvec3_dot(dvec3_of(node->normal), d)};
    v.distance = sqrt(v.square);
    const double radius = (double)node->radius, height = dvec3_dot(n, d),
                 off = (double)node->height + (double)node->bend * (v.distance + radius);
    v.height = height + radius;
    v.reach = v.other + off;
    v.whole = v.other >= off && kiln_link_is_above(node, n, height);
    return v;
}

/* The point of the node that the view of the point at `bit` is taken by: its place in the tree's order. A sequence
 * over the points' numbers, by the golden ratio; points of less area than others are taken less often. */
static inline uint32_t kiln_link_choose(const struct kiln_link_run *w, uint32_t bit, const struct kiln_link_node *node,
                                        uint32_t number)
{
    const struct kiln_links_parameters *p = w->p;
    const uint32_t hash = kiln_hash1(number);
    double u = (double)hash * 0x1p-32 + (double)w->patch[bit]->number * 0.61803398874989485;
    uint32_t k = node->first;
    for (uint32_t draw = 0; draw < KILN_LINK_DRAWS; draw++) {
        u -= floor(u);
        k = node->first + (uint32_t)(u * (double)node->count);
        const double chance = (double)kiln_hash2(hash + draw, w->patch[bit]->number) * 0x1p-32;
        if (chance * (double)node->most_area < (double)p->points[p->order[k]].area)
            break;
        u += 0.75487766624669276;
    }
    return k;
}

/* How many points in a row, a square of them, have one ray to a node: worker/pass/links.h. */
static inline uint32_t kiln_link_shared_by(const struct kiln_link_run *w, uint32_t to)
{
    const double radius = (to & KILN_LINK_LEAF) != 0 ? 0.0 : KILN_LINKS_SHARED * (double)w->p->nodes[to].radius;
    return 4.0 * w->texel <= radius ? 16 : 2.0 * w->texel <= radius ? 4 : 1;
}

#endif
