#include <string.h>

#include "worker/backend/link_run.h"
#include "worker/base/color.h"

/* Error of light that varies over a node, relative to radius / distance x the light's standard deviation. */
#define SPREAD 1.5

enum { AHEAD = 4 };

/* Exchanges adjacent squares of `side` points (consecutive in Morton order) in the mask. */
static uint64_t exchanged(uint64_t mask, uint32_t side)
{
    static const uint64_t first[] = {0x5555555555555555u, 0x3333333333333333u, 0x0f0f0f0f0f0f0f0fu,
                                     0x00ff00ff00ff00ffu, 0x0000ffff0000ffffu, 0x00000000ffffffffu};
    const uint64_t even = first[__builtin_ctz(side)];
    return (mask & even) << side | (mask >> side & even);
}

/* Masks for estimating the variance of a link's visibility from neighbouring points with rays of their own. */
struct unsure {
    uint64_t asked[3], other[3]; /* by neighbour: points whose neighbour has a ray too; those with another result */
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

/* Computes the variance of the link's visibility for the points of the mask. */
static void find_unsure(const struct unsure *u, uint64_t mask, double unsure[KILN_TILE_TEXELS])
{
    for (uint64_t rest = mask; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        uint32_t asked = 0, other = 0;
        for (int i = 0; i < 3; i++) {
            asked += (uint32_t)(u->asked[i] >> bit & 1);
            other += (uint32_t)(u->other[i] >> bit & 1);
        }
        unsure[bit] = (0.5 * (double)other + KILN_LINKS_UNSEEN) / (double)(asked + 1);
    }
}

/* Light that determines errors: now and before this bounce; or the first light, over its mean. */
static struct kiln_link_light light_of(const struct kiln_link_run *w, uint32_t to)
{
    const struct kiln_links_parameters *p = w->p;
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const uint32_t at = to & ~KILN_LINK_LEAF;
    if (!w->by_first)
        return leaf ? (struct kiln_link_light){.now = p->leaves[at].now, .before = p->leaves[at].before}
                    : p->sent[at].light;
    if (leaf)
        return (struct kiln_link_light){.now = p->first[p->order[at]]};
    const struct kiln_link_node *node = &p->nodes[at];
    return (struct kiln_link_light){.now = node->level, .spread_now = node->spread * node->spread};
}

/* Stores the factors of a lane that uses a single point, and that point's radiosity. */
static void enter_factors(struct kiln_link_lane_factors *f, uint32_t bit, struct kiln_patch_factors by,
                          const struct kiln_link_leaf *leaf)
{
    f->factor[bit] = by.factor;
    f->shading[bit] = by.shading;
    for (int c = 0; c < 3; c++)
        f->light[c][bit] = (double)leaf->radiosity[c];
}

static void find_leaf_factors(struct kiln_link_run *w, uint32_t k, uint64_t mask)
{
    const struct kiln_links_parameters *p = w->p;
    w->factors.whole = 0;
    for (uint64_t rest = mask; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        enter_factors(&w->factors, bit, kiln_leaf_factors(&w->receiver[bit], w->at[bit], &p->points[p->order[k]]),
                      &p->leaves[k]);
    }
}

/* Factors of a link to a node for the points of the mask: for points that see the node whole, the mean over it; for
 * others that of the point chosen to represent it. */
static void find_node_factors(struct kiln_link_run *w, uint32_t to, uint64_t mask)
{
    const struct kiln_links_parameters *p = w->p;
    const struct kiln_link_node *node = &p->nodes[to];
    struct kiln_link_lane_factors *f = &w->factors;
    kiln_link_lanes_factors(&w->lanes, node, mask, f);
    for (uint64_t rest = mask & ~f->whole; rest != 0; rest &= rest - 1)
        kiln_link_fetch(p, node, to, w->patch[__builtin_ctzll(rest)]->number);
    for (uint64_t rest = mask & ~f->whole; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const struct kiln_link_leaf *by = &p->leaves[kiln_link_choose(p, node, to, w->patch[bit]->number)];
        enter_factors(f, bit, kiln_link_node_factors_by(&w->receiver[bit], w->at[bit], by, (double)node->area), by);
    }
}

static void find_factors(struct kiln_link_run *w, uint32_t to, uint64_t mask)
{
    if ((to & KILN_LINK_LEAF) != 0)
        find_leaf_factors(w, to & ~KILN_LINK_LEAF, mask);
    else
        find_node_factors(w, to, mask);
}

/* Initializes a link to `to` with the share `through` of light let through; no point has it yet. */
static void begin_link(const struct kiln_link_run *w, uint32_t to, const float through[3],
                       struct kiln_link_lane_link *link)
{
    const struct kiln_links_parameters *p = w->p;
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const struct kiln_link_light l = light_of(w, to);
    const double now = (double)l.now, before = (double)l.before;
    link->sees = link->other = 0;
    link->through = ((double)through[0] + (double)through[1] + (double)through[2]) / 3.0;
    link->now = now;
    link->more = (double)l.spread_now - (double)l.spread_before;
    link->square = now * now - before * before + link->more;
    link->reach = leaf || !(link->through > 0.0) ? 0.0 : SPREAD * (double)p->nodes[to].radius;
    link->by_first = w->by_first;
    link->smooth = w->lanes.smooth;
    for (int c = 0; c < 3; c++) {
        link->filter[c] = (double)through[c];
        link->light[c] = leaf ? 0.0 : (double)p->sent[to].radiosity[c];
        for (int a = 0; a < 3; a++)
            link->moment[c][a] = leaf ? 0.0 : (double)p->sent[to].moment[c][a];
    }
}

/* Adds what the points `of` gather by a found link. Points that do not see the target, though some neighbours do, get
 * the variance of this. */
static void add_found(struct kiln_link_run *w, uint32_t i, uint64_t of)
{
    static const float all[3] = {1.0f, 1.0f, 1.0f};
    const struct kiln_found_links *f = &w->found;
    const struct unsure u = unsure_of(w, i);
    struct kiln_link_lane_link link;
    begin_link(w, f->to[i], all, &link);
    link.sees = f->seen[i] & f->asked[i] & of;
    link.other = (u.other[0] | u.other[1] | u.other[2]) & f->asked[i] & of & ~f->seen[i];
    find_unsure(&u, link.sees | link.other, link.unsure);
    find_factors(w, f->to[i], link.sees | link.other);
    kiln_link_lanes_add(&w->sums, &w->factors, &link);
}

static void add_tinted_link(struct kiln_link_run *w, const struct kiln_tinted_link *t)
{
    struct kiln_link_lane_link link;
    begin_link(w, t->to, t->through, &link);
    link.sees = 1ull << t->bit;
    link.unsure[t->bit] = 0.0;
    find_factors(w, t->to, link.sees);
    kiln_link_lanes_add(&w->sums, &w->factors, &link);
}

void kiln_link_run_add(struct kiln_link_run *w)
{
    const struct kiln_found_links *f = &w->found;
    const uint64_t of = w->by_first ? w->shares : w->valid;
    w->summed = !w->by_first;
    memset(&w->sums, 0, sizeof w->sums);
    for (uint32_t i = 0; i < f->count; i++) {
        if (i + AHEAD < f->count && (f->to[i + AHEAD] & KILN_LINK_LEAF) != 0)
            kiln_link_fetch_leaf(w->p, f->to[i + AHEAD] & ~KILN_LINK_LEAF);
        add_found(w, i, of);
    }
    for (uint32_t i = 0; i < f->tinted_count; i++)
        if ((of >> f->tinted[i].bit & 1) != 0)
            add_tinted_link(w, &f->tinted[i]);
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
        w->found.point[bit].scale = kiln_link_row_scale(&w->found.point[bit], w->sums.row[bit]);
    }
}

/* Standard error of the luminance of irradiance, after rows are closed. If a row is closed mostly by scaling, the error
 * comes from the visible links, not from the invisible ones. */
static double error_of(double scale, const struct kiln_link_sums *s)
{
    const double irradiance = kiln_luminance(s->irradiance), own = sqrt(fmax(0.0, s->variance)),
                 closed = kiln_patches_closed(scale, kiln_luminance(s->incident), irradiance);
    return fmin((irradiance > 0.0 ? closed / irradiance : scale) * own, fmax(closed, KILN_LINKS_CLOSED_MOST * own));
}

struct kiln_link_sums kiln_link_run_sums(const struct kiln_link_run *w, uint32_t bit)
{
    struct kiln_link_sums s = {.variance = w->sums.variance[bit]};
    for (int c = 0; c < 3; c++) {
        s.incident[c] = w->sums.incident[c][bit];
        s.irradiance[c] = w->lanes.smooth ? w->sums.irradiance[c][bit] : s.incident[c];
    }
    return s;
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

/* Whether the error of first light by the links found exceeds the target: root of the mean squared relative error over
 * the tile's points. */
static bool is_above_target(struct kiln_link_run *w)
{
    const struct kiln_links_parameters *p = w->p;
    double square = 0.0;
    w->by_first = true;
    kiln_link_run_add(w);
    w->by_first = false;
    for (uint64_t rest = w->shares; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const double light = (double)p->first[w->index[bit]] + w->sums.now[bit],
                     allowed = p->target * fmax(light, KILN_LINKS_LEAST_LIGHT);
        square += fmax(0.0, w->sums.variance[bit]) / (allowed * allowed);
    }
    return square > (double)__builtin_popcountll(w->shares);
}

bool kiln_link_run_opens(struct kiln_link_run *w)
{
    const double least = w->p->target / KILN_LINKS_BELOW_TARGET;
    const bool opens = w->p->target > 0.0 && w->found.opened < KILN_LINKS_MOST_OPENED &&
                       kiln_link_run_error(w) > least && is_above_target(w);
    w->found.opened += opens;
    return opens;
}
