/* View factors of links (links.h), from a point to a node of the tree. */
#ifndef KILN_WORKER_PASS_LINK_FACTORS_H
#define KILN_WORKER_PASS_LINK_FACTORS_H

#include <math.h>

#include "worker/pass/links.h"
#include "worker/pass/patch_factors.h"
#include "worker/sampling/keys.h"

#define KILN_LINK_NODE_FLAT 0.1 /* nodes with a smaller bend count as flat */
/* Squared distance of a rectangle's sides from its centre, in variances: 3, less a margin for rounding, so that the
 * node of a wall standing on the floor lies above the floor. */
#define KILN_LINK_NODE_RECTANGLE 2.9
enum { KILN_LINK_DRAWS = 4 };

/* Geometry of a node as seen from a point. */
struct kiln_link_node_view {
    struct kiln_dvec3 d;
    double distance, inverse, other; /* inverse: 1 / distance; other: -d . the node's normal */
    double height, reach;            /* upper bounds: of the node over the point's horizon, of the point over its */
    bool whole;                      /* the whole node is above the point's horizon and faces the point */
};

/* The covariance of the node's surface times a vector. */
static inline struct kiln_dvec3 kiln_link_node_covariance_times(const struct kiln_link_node *node, struct kiln_dvec3 v)
{
    const float *c = node->covariance;
    return dvec3((double)c[0] * v.x + (double)c[3] * v.y + (double)c[4] * v.z,
                 (double)c[3] * v.x + (double)c[1] * v.y + (double)c[5] * v.z,
                 (double)c[4] * v.x + (double)c[5] * v.y + (double)c[2] * v.z);
}

/* Whether a node lies above a plane with normal n. `height`: of its centre over the plane. The node is taken as a ball
 * or, if it is flat, as the rectangle that has its covariance. */
static inline bool kiln_link_node_is_above(const struct kiln_link_node *node, struct kiln_dvec3 n, double height)
{
    const double radius = (double)node->radius,
                 least = KILN_LINK_NODE_RECTANGLE * dvec3_dot(n, kiln_link_node_covariance_times(node, n));
    const bool flat = node->bend < KILN_LINK_NODE_FLAT;
    return (height >= radius) | (flat & (height > 0.0) & (height * height >= least));
}

/* Returns the view of the node from a point at `at` with the normal n. */
static inline struct kiln_link_node_view kiln_link_node_view_of(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                                                struct kiln_dvec3 at)
{
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(node->centre), at);
    struct kiln_link_node_view v = {
        .d = d, .distance = sqrt(dvec3_dot(d, d)), .other = -dvec3_dot(dvec3_of(node->normal), d)};
    v.inverse = 1.0 / v.distance;
    const double radius = (double)node->radius, height = dvec3_dot(n, d),
                 off = (double)node->height + (double)node->bend * (v.distance + radius);
    v.height = height + radius;
    v.reach = v.other + off;
    v.whole = (v.other >= off) & kiln_link_node_is_above(node, n, height);
    return v;
}

/* Mean of n.d / |d|^4 over the node's surface, divided by |d|^-4 at its centre, to the second order. For a disc that
 * faces the point it is (1 + x)^-2, where 2 x is the loss to that order. */
static inline double kiln_link_node_mean_height(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                                const struct kiln_link_node_view *v)
{
    const float *c = node->covariance;
    const struct kiln_dvec3 d = v->d, along = kiln_link_node_covariance_times(node, d);
    const double height = dvec3_dot(n, d), trace = (double)c[0] + (double)c[1] + (double)c[2],
                 per = v->inverse * v->inverse, more = (12.0 * dvec3_dot(d, along) * per - 2.0 * trace) * per,
                 less = 1.0 / ((1.0 - 0.5 * more) * (1.0 - 0.5 * more)), plus = 1.0 + more,
                 mean = height * (more < 0.0 ? less : plus) - 4.0 * dvec3_dot(n, along) * per;
    return mean > 0.0 ? mean : 0.0;
}

/* F of a node that is wholly visible from the point, about the normal n. */
static inline double kiln_link_node_factor(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                           const struct kiln_link_node_view *v)
{
    const double per = v->inverse * v->inverse, far = (double)node->area * (1.0 / KILN_PI) * v->other * per * per;
    return far * kiln_link_node_mean_height(node, n, v);
}

/* Gradient of F with respect to the position of a small node, about the normal n. */
static inline struct kiln_dvec3 kiln_link_node_slope(const struct kiln_link_node *node, struct kiln_dvec3 n,
                                                     const struct kiln_link_node_view *v)
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

/* Chooses the point of a node that stands for it in the link of receiver `number`; returns its place in the tree's
 * order. `to`: the node's number. Points with less area are chosen less often. */
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

/* Prefetches the point that kiln_link_choose tries first and mostly takes: points lie far apart in memory. */
static inline void kiln_link_fetch(const struct kiln_links_parameters *p, const struct kiln_link_node *node,
                                   uint32_t to, uint32_t number)
{
    __builtin_prefetch(&p->leaves[node->first + (uint32_t)(kiln_link_draw(to, number) * (double)node->count)]);
}

/* Prefetches the point of a link to a single point. */
static inline void kiln_link_fetch_leaf(const struct kiln_links_parameters *p, uint32_t k)
{
    const char *patch = (const char *)&p->points[p->order[k]];
    __builtin_prefetch(&p->leaves[k]);
    __builtin_prefetch(patch);
    __builtin_prefetch(patch + sizeof(struct kiln_patch) - 1);
}

/* Factors of a node as if its whole area were at its point `by`; zeros if one does not face the other. */
static inline struct kiln_patch_factors kiln_link_node_factors_by(const struct kiln_patch_receiver *receiver,
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

/* Factors of a link to a single point; zeros if one does not face the other. */
static inline struct kiln_patch_factors kiln_leaf_factors(const struct kiln_patch_receiver *receiver,
                                                          struct kiln_dvec3 at, const struct kiln_patch *from)
{
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(from->centre), at);
    const double cosine = dvec3_dot(receiver->n, d), other = -dvec3_dot(dvec3_of(from->normal), d);
    if (!(cosine > 0.0 && other > 0.0))
        return (struct kiln_patch_factors){0.0, 0.0};
    return kiln_patch_factors(receiver, from, d, dvec3_dot(d, d), cosine, other);
}

/* F of a link to `to` from the point at `at`, which has this number. *v: view of the node; a single point is never
 * `whole`. */
static inline struct kiln_patch_factors kiln_link_factors(const struct kiln_links_parameters *p,
                                                          const struct kiln_patch_receiver *receiver,
                                                          struct kiln_dvec3 at, uint32_t number, uint32_t to,
                                                          struct kiln_link_node_view *v)
{
    struct kiln_patch_factors f;
    if ((to & KILN_LINK_LEAF) != 0) {
        v->whole = false;
        return kiln_leaf_factors(receiver, at, &p->points[p->order[to & ~KILN_LINK_LEAF]]);
    }
    const struct kiln_link_node *node = &p->nodes[to];
    *v = kiln_link_node_view_of(node, receiver->n, at);
    if (!v->whole)
        return kiln_link_node_factors_by(receiver, at, &p->leaves[kiln_link_choose(p, node, to, number)],
                                         (double)node->area);
    f.factor = kiln_link_node_factor(node, receiver->n, v);
    f.shading = receiver->smooth ? kiln_link_node_factor(node, receiver->s, v) : f.factor;
    return f;
}

#endif
