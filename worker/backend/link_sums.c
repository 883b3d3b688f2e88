#include <string.h>

#include "worker/backend/link_view.h"
#include "worker/base/color.h"

/* What light that varies over a node is off by, over the radii in its distance times the deviation. */
#define SPREAD 1.5

/* ---- factors ---- */

/* n.d / |d|^4, in the mean over the node's surface, over |d|^-4 at its centre: to the second order. That of a
 * disc that faces the point is (1 + x)^-2, x half of what it is less by to that order. */
static double mean_height(const struct kiln_link_node *node, struct kiln_dvec3 n, const struct kiln_node_view *v)
{
    const float *c = node->covariance;
    const struct kiln_dvec3 d = v->d, along = kiln_link_covariance_times(node, d);
    const double height = dvec3_dot(n, d), trace = (double)c[0] + (double)c[1] + (double)c[2],
                 more = (12.0 * dvec3_dot(d, along) / v->square - 2.0 * trace) / v->square,
                 stretched = more < 0.0 ? 1.0 / ((1.0 - 0.5 * more) * (1.0 - 0.5 * more)) : 1.0 + more;
    return fmax(0.0, height * stretched - 4.0 * dvec3_dot(n, along) / v->square);
}

/* Of the surface of a patch with this area in the place of its own. False: one does not see the other. */
static bool patch_factors_of(const struct kiln_patch_receiver *receiver, struct kiln_dvec3 at,
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

/* F of a link of the point at `bit`; *v: how it sees the node, which is not whole where it is a point. */
static struct kiln_patch_factors link_factors(const struct kiln_link_run *w, uint32_t bit, uint32_t to,
                                              struct kiln_node_view *v)
{
    const struct kiln_links_parameters *p = w->p;
    const struct kiln_patch_receiver *receiver = &w->receiver[bit];
    struct kiln_patch_factors f = {0.0, 0.0};
    if ((to & KILN_LINK_LEAF) != 0) {
        v->whole = false;
        (void)patch_factors_of(receiver, w->at[bit], &p->points[p->order[to & ~KILN_LINK_LEAF]], 0.0, &f);
        return f;
    }
    const struct kiln_link_node *node = &p->nodes[to];
    *v = kiln_link_view_of(w, bit, node);
    if (v->whole) {
        const double far = (double)node->area * v->other / (KILN_PI * v->square * v->square);
        f.factor = far * mean_height(node, receiver->n, v);
        f.shading = receiver->smooth ? far * mean_height(node, receiver->s, v) : f.factor;
    } else {
        const struct kiln_patch *from = &p->points[p->order[kiln_link_choose(w, bit, node, to)]];
        (void)patch_factors_of(receiver, w->at[bit], from, (double)node->area, &f);
    }
    return f;
}

/* ---- sums ---- */

/* The mask with the points of squares of `side` points in a row exchanged in pairs: Morton order. */
static uint64_t exchanged(uint64_t mask, uint32_t side)
{
    static const uint64_t first[] = {0x5555555555555555u, 0x3333333333333333u, 0x0f0f0f0f0f0f0f0fu,
                                     0x00ff00ff00ff00ffu, 0x0000ffff0000ffffu, 0x00000000ffffffffu};
    const uint64_t even = first[__builtin_ctz(side)];
    return (mask & even) << side | (mask >> side & even);
}

/* The variance of what points see by a link, estimated of the points beside them that have rays of their own. */
struct unsure {
    uint64_t asked[3], other[3]; /* by neighbour: who has one that has asked, and whose sees what it does not or not */
};

static struct unsure unsure_of(const struct kiln_link_run *w, uint32_t link)
{
    const uint32_t side = kiln_link_shared_by(w, w->found.to[link]);
    const uint64_t asked = w->found.asked[link] & w->shares, seen = w->found.seen[link];
    struct unsure u;
    for (int i = 0; i < 3; i++) {
        uint64_t there = asked, sees = seen;
        if (i != 1) {
            there = exchanged(there, side);
            sees = exchanged(sees, side);
        }
        if (i != 0) {
            there = exchanged(there, 2 * side);
            sees = exchanged(sees, 2 * side);
        }
        u.asked[i] = there & asked;
        u.other[i] = (sees ^ seen) & u.asked[i];
    }
    return u;
}

static double variance_of(const struct unsure *u, uint32_t bit)
{
    uint32_t asked = 0, other = 0;
    for (int i = 0; i < 3; i++) {
        asked += (uint32_t)(u->asked[i] >> bit & 1);
        other += (uint32_t)(u->other[i] >> bit & 1);
    }
    return (0.5 * (double)other + KILN_LINKS_UNSEEN) / (double)(asked + 1);
}

/* The light that errors are of: so far and before this bounce; or the first, over its mean. */
static struct kiln_link_light light_of(const struct kiln_link_run *w, uint32_t to)
{
    const struct kiln_links_parameters *p = w->p;
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const uint32_t at = to & ~KILN_LINK_LEAF;
    if (!w->by_first)
        return leaf ? p->leaf_light[at] : p->light[at];
    if (leaf)
        return (struct kiln_link_light){.now = p->first[p->order[at]]};
    const struct kiln_link_node *node = &p->nodes[at];
    return (struct kiln_link_light){.now = node->level, .spread_now = node->spread * node->spread};
}

/* What a link does to the error of the point at `bit`; q: the variance of what it sees. */
static void add_variance(struct kiln_link_run *w, uint32_t bit, uint32_t to, const struct kiln_node_view *v,
                         double factor, double seen, double q)
{
    const struct kiln_links_parameters *p = w->p;
    const struct kiln_link_light l = light_of(w, to);
    const double now = (double)l.now, before = (double)l.before, more = (double)l.spread_now - (double)l.spread_before;
    double square = q * (now * now - before * before + more);
    if ((to & KILN_LINK_LEAF) == 0 && seen > 0.0) {
        const double rho = SPREAD * (double)p->nodes[to].radius / v->distance;
        square += v->whole ? rho * rho * more : now * now - before * before + more;
    }
    w->variance[bit] += factor * factor * square;
    w->now[bit] += factor * seen * now;
}

static void add_link(struct kiln_link_run *w, uint32_t bit, uint32_t to, const float through[3], double q)
{
    const struct kiln_links_parameters *p = w->p;
    const float *radiosity = (to & KILN_LINK_LEAF) != 0 ? p->leaf_radiosity[to & ~KILN_LINK_LEAF] : p->radiosity[to];
    struct kiln_node_view v;
    const struct kiln_patch_factors f = link_factors(w, bit, to, &v);
    const double seen = ((double)through[0] + (double)through[1] + (double)through[2]) / 3.0;
    w->row[bit] += f.factor * seen;
    for (int c = 0; c < 3; c++) {
        const double light = (double)radiosity[c] * (double)through[c];
        w->incident[bit][c] += f.factor * light;
        w->irradiance[bit][c] += f.shading * light;
    }
    add_variance(w, bit, to, &v, w->by_first ? f.factor : f.shading, seen, q);
}

/* A link by which the point at `bit` sees nothing, though some beside it do. */
static void add_unseen(struct kiln_link_run *w, uint32_t bit, uint32_t to, double q)
{
    struct kiln_node_view v;
    const double factor = link_factors(w, bit, to, &v).factor;
    add_variance(w, bit, to, &v, factor, 0.0, q);
}

void kiln_link_run_add(struct kiln_link_run *w)
{
    static const float all[3] = {1.0f, 1.0f, 1.0f};
    const struct kiln_found_links *f = &w->found;
    const uint64_t of = w->by_first ? w->shares : w->valid;
    w->summed = !w->by_first;
    memset(w->row, 0, sizeof w->row);
    memset(w->incident, 0, sizeof w->incident);
    memset(w->irradiance, 0, sizeof w->irradiance);
    memset(w->now, 0, sizeof w->now);
    memset(w->variance, 0, sizeof w->variance);
    for (uint32_t i = 0; i < f->count; i++) {
        const struct unsure u = unsure_of(w, i);
        for (uint64_t rest = f->asked[i] & of; rest != 0; rest &= rest - 1) {
            const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
            if ((f->seen[i] >> bit & 1) != 0)
                add_link(w, bit, f->to[i], all, variance_of(&u, bit));
            else if (((u.other[0] | u.other[1] | u.other[2]) >> bit & 1) != 0)
                add_unseen(w, bit, f->to[i], variance_of(&u, bit));
        }
    }
    for (uint32_t i = 0; i < f->tinted_count; i++)
        if ((of >> f->tinted[i].bit & 1) != 0)
            add_link(w, f->tinted[i].bit, f->tinted[i].to, f->tinted[i].through, 0.0);
}

float kiln_link_row_scale(const struct kiln_linked_point *l, double row)
{
    const struct kiln_point_result met = {.escaped = l->escaped,
                                          .blocked = l->blocked,
                                          .glass = {l->glass[0], l->glass[1], l->glass[2]},
                                          .count = l->count};
    return (float)kiln_patches_row_scale(&met, row);
}

void kiln_link_run_close(struct kiln_link_run *w)
{
    for (uint64_t rest = w->valid; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        w->found.point[bit].scale = kiln_link_row_scale(&w->found.point[bit], w->row[bit]);
    }
}

/* Standard error of the luminance of irradiance, as that is closed. */
static double error_of(double scale, const struct kiln_link_sums *s)
{
    const double irradiance = kiln_luminance(s->irradiance),
                 closed = kiln_patches_closed(scale, kiln_luminance(s->incident), irradiance);
    return (irradiance > 0.0 ? closed / irradiance : scale) * sqrt(fmax(0.0, s->variance));
}

struct kiln_point_result kiln_link_answer(const struct kiln_linked_point *point, const struct kiln_link_sums *s)
{
    const double count = (double)point->count, scale = (double)point->scale * count;
    if (point->count == 0)
        return (struct kiln_point_result){.count = 0};
    struct kiln_point_result r = {.escaped = point->escaped,
                                  .blocked = point->blocked,
                                  .glass = {point->glass[0], point->glass[1], point->glass[2]},
                                  .present = point->present,
                                  .count = point->count,
                                  .error = (float)(count * error_of((double)point->scale, s))};
    for (int c = 0; c < 3; c++) {
        r.incident[c] = (float)(scale * s->incident[c]);
        r.irradiance[c] = (float)(count * kiln_patches_closed((double)point->scale, s->incident[c], s->irradiance[c]));
    }
    return r;
}

bool kiln_link_run_is_above_target(struct kiln_link_run *w)
{
    const struct kiln_links_parameters *p = w->p;
    double square = 0.0;
    w->by_first = true;
    kiln_link_run_add(w);
    w->by_first = false;
    for (uint64_t rest = w->shares; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const double light = (double)p->first[w->index[bit]] + w->now[bit],
                     allowed = p->target * fmax(light, KILN_LINKS_LEAST_LIGHT);
        square += fmax(0.0, w->variance[bit]) / (allowed * allowed);
    }
    return square > (double)__builtin_popcountll(w->shares);
}
