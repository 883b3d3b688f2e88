/* View factors of links (links.h): how a point sees a node of the tree. */
#ifndef KILN_WORKER_PASS_LINK_FACTORS_H
#define KILN_WORKER_PASS_LINK_FACTORS_H

#include <math.h>

#include "worker/pass/links.h"
#include "worker/pass/patch_factors.h"
#include "worker/sampling/keys.h"

#define KILN_NODE_FLAT 0.1 /* bend of nodes that count as flat */
/* The square of how far a rectangle's sides are, in standard deviations: 3, less what rounding may be: a wall's node
 * that stands on the floor lies above it. */
#define KILN_NODE_RECTANGLE 2.9
enum { KILN_LINK_DRAWS = 4 };

/* How a point sees a node. */
struct kiln_node_view {
    struct kiln_dvec3 d;
    double distance, inverse, other; /* inverse: 1 / distance; other: -d about the node's normal */
    double height, reach; /* the highest that it may stand over the point's horizon; and the point over its */
    bool whole;           /* all of it is above the horizon and faces the point */
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
    struct kiln_node_view v = {
        .d = d, .distance = sqrt(dvec3_dot(d, d)), .other = -dvec3_dot(dvec3_of(node->normal), d)};
    v.inverse = 1.0 / v.distance;
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
                 per = v->inverse * v->inverse, more = (12.0 * dvec3_dot(d, along) * per - 2.0 * trace) * per,
                 less = 1.0 / ((1.0 - 0.5 * more) * (1.0 - 0.5 * more)), plus = 1.0 + more,
                 mean = height * (more < 0.0 ? less : plus) - 4.0 * dvec3_dot(n, along) * per;
    return mean > 0.0 ? mean : 0.0;
}

/* F of a node that the point has whole before it, about the normal n. */
static inline double kiln_node_factor(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                      const struct kiln_node_view *v)
{
    const double per = v->inverse * v->inverse, far = (double)node->area * (1.0 / KILN_PI) * v->other * per * per;
    return far * kiln_node_mean_height(node, n, v);
}

/* The gradient of F by the place of a small node, about the normal n. */
static inline struct kiln_dvec3 kiln_node_slope(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                                const struct kiln_node_view *v)
{
    const double per = v->inverse * v->inverse, far = (double)node->area * (1.0 / KILN_PI) * per * per,
                 height = dvec3_dot(n, v->d), along = 4.0 * height * v->other * per;
    const struct kiln_dvec3 m = dvec3_of(node->normal);
    return dvec3(far * (v->other * n.x - height * m.x - along * v->d.x),
                 far * (v->other * n.y - height * m.y - along * v->d.y),
                 far * (v->other * n.z - height * m.z - along * v->d.z));
}

/* Returns term `number` of a sequence by the golden ratio, whose first term node `to` decides. */
static inline double kiln_link_draw(uint32_t to, uint32_t number)
{
    const double u = (double)kiln_hash1(to) * 0x1p-32 + (double)number * 0.61803398874989485;
    return u - floor(u);
}

/* The point of the node that the view with this number is taken by: its place in the tree's order. `to`: the node's
 * number. Points of less area than others are taken less often. */
static inline uint32_t kiln_link_choose(const struct kiln_links_parameters *p, const struct kiln_link_node *node,
                                        uint32_t to, uint32_t number)
{
    const uint32_t hash = kiln_hash1(to);
    double u = kiln_link_draw(to, number);
    uint32_t k = node->first;
    for (uint32_t draw = 0; draw < KILN_LINK_DRAWS; draw++) {
        k = node->first + (uint32_t)(u * (double)node->count);
        const double chance = (double)kiln_hash2(hash + draw, number) * 0x1p-32;
        if (chance * (double)node->most_area < (double)p->leaves[k].area)
            break;
        u += 0.75487766624669276;
        u -= floor(u);
    }
    return k;
}

/* Has the point fetched that kiln_link_choose looks at first, and mostly takes: points lie far apart in memory. */
static inline void kiln_link_fetch(const struct kiln_links_parameters *p, const struct kiln_link_node *node,
                                   uint32_t to, uint32_t number)
{
    __builtin_prefetch(&p->leaves[node->first + (uint32_t)(kiln_link_draw(to, number) * (double)node->count)]);
}

/* Has a link's point fetched. */
static inline void kiln_link_fetch_leaf(const struct kiln_links_parameters *p, uint32_t k)
{
    const char *patch = (const char *)&p->points[p->order[k]];
    __builtin_prefetch(&p->leaves[k]);
    __builtin_prefetch(patch);
    __builtin_prefetch(patch + sizeof(struct kiln_patch) - 1);
}

/* Factors of a node's surface, as if all of it were at this point of it; zeros: one does not see the other. */
static inline struct kiln_patch_factors kiln_node_factors_by(const struct kiln_patch_receiver *receiver,
                                                             struct kiln_dvec3 at, const struct kiln_link_leaf *by,
                                                             double area)
{
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(by->centre), at);
    const double cosine = dvec3_dot(receiver->n, d), other = -dvec3_dot(dvec3_of(by->normal), d),
                 square = dvec3_dot(d, d), far = area * other / (KILN_PI * square * square);
    if (!(cosine > 0.0 && other > 0.0))
        return (struct kiln_patch_factors){0.0, 0.0};
    return (struct kiln_patch_factors){far * cosine, far * fmax(0.0, dvec3_dot(receiver->s, d))};
}

/* Factors of a single point; zeros: one does not see the other. */
static inline struct kiln_patch_factors kiln_leaf_factors(const struct kiln_patch_receiver *receiver,
                                                          struct kiln_dvec3 at, const struct kiln_patch *from)
{
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(from->centre), at);
    const double cosine = dvec3_dot(receiver->n, d), other = -dvec3_dot(dvec3_of(from->normal), d);
    if (!(cosine > 0.0 && other > 0.0))
        return (struct kiln_patch_factors){0.0, 0.0};
    return kiln_patch_factors(receiver, from, d, dvec3_dot(d, d), cosine, other);
}

/* F of a link of the point at `at` with this number; *v: how it sees the node, which is not whole where it is a point.
 */
static inline struct kiln_patch_factors kiln_link_factors(const struct kiln_links_parameters *p,
                                                          const struct kiln_patch_receiver *receiver,
                                                          struct kiln_dvec3 at, uint32_t number, uint32_t to,
                                                          struct kiln_node_view *v)
{
    struct kiln_patch_factors f;
    if ((to & KILN_LINK_LEAF) != 0) {
        v->whole = false;
        return kiln_leaf_factors(receiver, at, &p->points[p->order[to & ~KILN_LINK_LEAF]]);
    }
    const struct kiln_link_node *node = &p->nodes[to];
    *v = kiln_node_view_of(node, receiver->n, at);
    if (!v->whole)
        return kiln_node_factors_by(receiver, at, &p->leaves[kiln_link_choose(p, node, to, number)],
                                    (double)node->area);
    f.factor = kiln_node_factor(node, receiver->n, v);
    f.shading = receiver->smooth ? kiln_node_factor(node, receiver->s, v) : f.factor;
    return f;
}

#endif
