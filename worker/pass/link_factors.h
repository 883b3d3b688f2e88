/* View factors of links (links.h): how a point sees a node of the tree. */
#ifndef KILN_WORKER_PASS_LINK_FACTORS_H
#define KILN_WORKER_PASS_LINK_FACTORS_H

#include <math.h>

#include "worker/pass/links.h"
#include "worker/pass/patch_factors.h"
#include "worker/sampling/keys.h"

#define KILN_NODE_FLAT 0.1 /* bend of nodes that count as flat */
/* the square of how far a rectangle's sides are, in standard deviations: 3, and rounding */
#define KILN_NODE_RECTANGLE 3.1
enum { KILN_LINK_DRAWS = 4 };

/* How a point sees a node. */
struct kiln_node_view {
    struct kiln_dvec3 d;
    double square, distance, other; /* other: -d about the node's normal */
    double height, reach;           /* the highest that it may stand over the point's horizon; and the point over its */
    bool whole;                     /* all of it is above the horizon and faces the point */
};

/* The covariance of the node's surface times a vector. */
static inline struct kiln_dvec3 kiln_node_covariance_times(const struct kiln_link_node *node, struct kiln_dvec3 v)
{
    const float *c = node->covariance;
    return dvec3((double)c[0] * v.x + (double)c[3] * v.y + (double)c[4] * v.z,
                 (double)c[3] * v.x + (double)c[1] * v.y + (double)c[5] * v.z,
                 (double)c[4] * v.x + (double)c[5] * v.y + (double)c[2] * v.z);
}

/* Whether a node whose centre stands so high over a plane with this normal lies above it: as a ball, or, where it is
 * flat, as the rectangle that has its covariance. */
static inline bool kiln_node_is_above(const struct kiln_link_node *node, struct kiln_dvec3 n, double height)
{
    const double radius = (double)node->radius,
                 least = KILN_NODE_RECTANGLE * dvec3_dot(n, kiln_node_covariance_times(node, n));
    const bool flat = node->bend < KILN_NODE_FLAT;
    return (height >= radius) | (flat & (height > 0.0) & (height * height >= least));
}

/* How a point at `at` with the normal n sees the node. */
static inline struct kiln_node_view kiln_node_view_of(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                                      struct kiln_dvec3 at)
{
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(node->centre), at);
    struct kiln_node_view v = {.d = d, .square = dvec3_dot(d, d), .other = -dvec3_dot(dvec3_of(node->normal), d)};
    v.distance = sqrt(v.square);
    const double radius = (double)node->radius, height = dvec3_dot(n, d),
                 off = (double)node->height + (double)node->bend * (v.distance + radius);
    v.height = height + radius;
    v.reach = v.other + off;
    v.whole = (v.other >= off) & kiln_node_is_above(node, n, height);
    return v;
}

/* n.d / |d|^4, in the mean over the node's surface, over |d|^-4 at its centre: to the second order. That of a
 * disc that faces the point is (1 + x)^-2, x half of what it is less by to that order. */
static inline double kiln_node_mean_height(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                           const struct kiln_node_view *v)
{
    const float *c = node->covariance;
    const struct kiln_dvec3 d = v->d, along = kiln_node_covariance_times(node, d);
    const double height = dvec3_dot(n, d), trace = (double)c[0] + (double)c[1] + (double)c[2],
                 more = (12.0 * dvec3_dot(d, along) / v->square - 2.0 * trace) / v->square,
                 less = 1.0 / ((1.0 - 0.5 * more) * (1.0 - 0.5 * more)), plus = 1.0 + more,
                 mean = height * (more < 0.0 ? less : plus) - 4.0 * dvec3_dot(n, along) / v->square;
    return mean > 0.0 ? mean : 0.0;
}

/* F of a node that the point has whole before it, about the normal n. */
static inline double kiln_node_factor(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                      const struct kiln_node_view *v)
{
    const double far = (double)node->area * v->other / (KILN_PI * v->square * v->square);
    return far * kiln_node_mean_height(node, n, v);
}

/* The point of the node that the view of the point with this number is taken by: its place in the tree's order. `to`:
 * the node's number. A sequence over the points' numbers, by the golden ratio; points of less area than others are
 * taken less often. */
static inline uint32_t kiln_link_choose(const struct kiln_links_parameters *p, const struct kiln_link_node *node,
                                        uint32_t to, uint32_t number)
{
    const uint32_t hash = kiln_hash1(to);
    double u = (double)hash * 0x1p-32 + (double)number * 0.61803398874989485;
    uint32_t k = node->first;
    for (uint32_t draw = 0; draw < KILN_LINK_DRAWS; draw++) {
        u -= floor(u);
        k = node->first + (uint32_t)(u * (double)node->count);
        const double chance = (double)kiln_hash2(hash + draw, number) * 0x1p-32;
        if (chance * (double)node->most_area < (double)p->area[k])
            break;
        u += 0.75487766624669276;
    }
    return k;
}

/* Has a point of the tree fetched: they lie far apart in memory. */
static inline void kiln_link_fetch(const struct kiln_links_parameters *p, uint32_t k)
{
    const char *patch = (const char *)&p->points[p->order[k]];
    __builtin_prefetch(patch);
    __builtin_prefetch(patch + sizeof(struct kiln_patch) - 1);
}

/* Of the surface of a patch with this area in the place of its own. False: one does not see the other. */
static inline bool kiln_patch_factors_of(const struct kiln_patch_receiver *receiver, struct kiln_dvec3 at,
                                         const struct kiln_patch *from, double area, struct kiln_patch_factors *f)
{
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(from->centre), at);
    const double cosine = dvec3_dot(receiver->n, d), other = -dvec3_dot(dvec3_of(from->normal), d),
                 square = dvec3_dot(d, d);
    if (!(cosine > 0.0 && other > 0.0))
        return false;
    if (area > 0.0) {
        const double far = area * other / (KILN_PI * square * square);
        *f = (struct kiln_patch_factors){far * cosine, far * fmax(0.0, dvec3_dot(receiver->s, d))};
    } else {
        *f = kiln_patch_factors(receiver, from, d, square, cosine, other);
    }
    return true;
}

/* F of a link of the point at `at` with this number; *v: how it sees the node, which is not whole where it is a point.
 */
static inline struct kiln_patch_factors kiln_link_factors(const struct kiln_links_parameters *p,
                                                          const struct kiln_patch_receiver *receiver,
                                                          struct kiln_dvec3 at, uint32_t number, uint32_t to,
                                                          struct kiln_node_view *v)
{
    struct kiln_patch_factors f = {0.0, 0.0};
    if ((to & KILN_LINK_LEAF) != 0) {
        v->whole = false;
        (void)kiln_patch_factors_of(receiver, at, &p->points[p->order[to & ~KILN_LINK_LEAF]], 0.0, &f);
        return f;
    }
    const struct kiln_link_node *node = &p->nodes[to];
    *v = kiln_node_view_of(node, receiver->n, at);
    if (v->whole) {
        f.factor = kiln_node_factor(node, receiver->n, v);
        f.shading = receiver->smooth ? kiln_node_factor(node, receiver->s, v) : f.factor;
    } else {
        const struct kiln_patch *from = &p->points[p->order[kiln_link_choose(p, node, to, number)]];
        (void)kiln_patch_factors_of(receiver, at, from, (double)node->area, &f);
    }
    return f;
}

#endif
