#include <math.h>
#include <string.h>

#include "worker/backend/link_run.h"

#define ALIKE 0.5     /* least cosine between normals of points that share a ray */
#define TOGETHER 1.25 /* largest distance of such points, in texels per point in a row */

enum { STACK = 512 };

void kiln_link_run_release(struct kiln_link_run *w) { kiln_found_links_release(&w->found); }

/* ---- points ---- */

static void enter_lane(double lanes[3][KILN_TILE_TEXELS], uint32_t bit, struct kiln_dvec3 v)
{
    lanes[0][bit] = v.x, lanes[1][bit] = v.y, lanes[2][bit] = v.z;
}

static void enter_point(struct kiln_link_run *w, uint32_t bit, uint64_t index)
{
    const struct kiln_patch *patch = &w->p->points[index];
    w->index[bit] = index;
    w->patch[bit] = patch;
    w->at[bit] = dvec3_of(patch->place);
    w->receiver[bit] = (struct kiln_patch_receiver){dvec3_of(patch->normal), dvec3_of(patch->normal), false};
    enter_lane(w->lanes.at, bit, w->at[bit]);
    enter_lane(w->lanes.n, bit, w->receiver[bit].n);
    enter_lane(w->lanes.s, bit, w->receiver[bit].n);
    if (!(patch->area > 0.0f))
        return;
    w->shares |= 1ull << bit;
    w->texel = fmax(
        w->texel, sqrt((double)fmaxf(vec3_dot(patch->edge_s, patch->edge_s), vec3_dot(patch->edge_t, patch->edge_t))));
}

/* Whether points can share a ray: they are close together, with similar normals; not those of two charts. */
static bool lie_together(const struct kiln_link_run *w, uint64_t points, double within)
{
    const uint32_t lead = (uint32_t)__builtin_ctzll(points);
    for (uint64_t rest = points & (points - 1); rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const struct kiln_dvec3 d = dvec3_sub(w->at[bit], w->at[lead]);
        if (w->p->rooms[w->index[bit]] != w->p->rooms[w->index[lead]])
            return false;
        if (dvec3_dot(d, d) > within * within || dvec3_dot(w->receiver[bit].n, w->receiver[lead].n) < ALIKE)
            return false;
    }
    return true;
}

static void find_together(struct kiln_link_run *w)
{
    for (uint32_t k = 0; k < 2; k++) {
        const uint32_t side = k == 0 ? 4 : 16;
        const double within = (k == 0 ? 2.0 : 4.0) * TOGETHER * w->texel;
        w->together[k] = 0;
        for (uint32_t first = 0; first < KILN_TILE_TEXELS; first += side) {
            const uint64_t points = ((1ull << side) - 1) << first & w->shares;
            if (points != 0 && lie_together(w, points, within))
                w->together[k] |= points;
        }
    }
}

/* Enters the points of the run, and others of its tile: shared rays must not depend on cells. */
void kiln_link_run_enter(struct kiln_link_run *w, const struct kiln_surface *s, const struct kiln_tile_run *run)
{
    const struct kiln_tile *tile = &s->tiles[s->lightmaps[run->map].tile_first + run->tile];
    uint32_t place = 0;
    w->mask = run->mask;
    w->shares = 0;
    w->found.opened = 0;
    w->texel = 0.0;
    for (uint64_t rest = tile->mask | run->mask; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        if ((run->mask >> bit & 1) != 0) {
            w->bit[place] = (uint8_t)bit;
            enter_point(w, bit, run->first.at + place++);
        } else {
            enter_point(w, bit, kiln_tile_point(s, tile, bit).at);
        }
    }
    find_together(w);
}

/* Enters the points' shading normals, and which points receive light. */
void kiln_link_run_enter_found(struct kiln_link_run *w)
{
    w->valid = 0;
    w->lanes.smooth = w->found.smooth;
    for (uint64_t rest = w->mask; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const float *s = w->found.shading[bit];
        const struct kiln_linked_point *point = &w->found.point[bit];
        if (point->count == 0)
            continue;
        w->valid |= rest & -rest;
        w->receiver[bit].smooth = w->found.smooth;
        if (w->found.smooth)
            w->receiver[bit].s = dvec3((double)s[0], (double)s[1], (double)s[2]);
        enter_lane(w->lanes.s, bit, w->receiver[bit].s);
    }
}

void kiln_link_run_meet(struct kiln_link_run *w, uint32_t bit, const struct kiln_point_result *g)
{
    w->found.point[bit] = (struct kiln_linked_point){.escaped = g->escaped,
                                                     .blocked = g->blocked,
                                                     .glass = {g->glass[0], g->glass[1], g->glass[2]},
                                                     .present = g->present,
                                                     .count = g->count};
}

int kiln_link_run_take(struct kiln_link_run *w, const struct kiln_kept_links *kept, struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->p;
    const int status = kiln_links_decode(&w->found, kept, w->mask, w->shares, p->node_count, p->count, error);
    if (status == KILN_OK)
        kiln_link_run_enter_found(w);
    return status;
}

/* ---- finding links ---- */

double kiln_link_run_error(const struct kiln_link_run *w) { return ldexp(w->p->error, -(int)w->found.opened); }

bool kiln_link_run_is_to_judge(const struct kiln_links_parameters *p, const struct kiln_kept_links *kept)
{
    return p->target > 0.0 && kept->is_judged == 0;
}

uint32_t kiln_link_shared_by(const struct kiln_link_run *w, uint32_t to)
{
    const double radius =
        (to & KILN_LINK_LEAF) != 0 ? 0.0 : kiln_links_shared(kiln_link_run_error(w)) * (double)w->p->nodes[to].radius;
    return 4.0 * w->texel <= radius ? 16 : 2.0 * w->texel <= radius ? 4 : 1;
}

/* The point to which a question's ray goes: its index in the tree's order. */
static uint32_t asked_of(const struct kiln_link_run *w, const struct kiln_link_question *q)
{
    const uint32_t to = w->found.to[q->link];
    return (to & KILN_LINK_LEAF) != 0 ? to & ~KILN_LINK_LEAF
                                      : kiln_link_choose(w->p, &w->p->nodes[to], to, w->patch[q->bit]->number);
}

/* Requests the ray, if the two points face each other; k: the other point's index in the tree's order. */
static int ask(const struct kiln_link_run *w, const struct kiln_link_question *q, uint32_t k, struct kiln_error *error)
{
    const struct kiln_link_leaf *other = &w->p->leaves[k];
    const struct kiln_patch *own = w->patch[q->bit];
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(other->centre), w->at[q->bit]);
    const bool first = own->number < other->number;
    if (!(dvec3_dot(w->receiver[q->bit].n, d) > 0.0 && dvec3_dot(dvec3_of(other->normal), d) < 0.0))
        return KILN_OK;
    const struct kiln_link_sight sight = {first ? own->place : other->place, first ? other->place : own->place, q->bit,
                                          k, !first};
    return w->ask(w->context, q->link, q->of, &sight, error);
}

/* Requests the rays of all questions. Chooses all points first, so that their memory accesses overlap. */
static int ask_all(struct kiln_link_run *w, struct kiln_error *error)
{
    uint32_t k[KILN_LINK_QUESTIONS];
    int status = KILN_OK;
    for (uint32_t i = 0; i < w->question_count; i++)
        k[i] = asked_of(w, &w->questions[i]);
    for (uint32_t i = 0; i < w->question_count && status == KILN_OK; i++)
        status = ask(w, &w->questions[i], k[i], error);
    w->question_count = 0;
    return status;
}

/* Queues the question whether the point at `bit` sees the target of link `link`, on behalf of the points `of`. */
static int note(struct kiln_link_run *w, uint32_t link, uint32_t bit, uint64_t of, struct kiln_error *error)
{
    const uint32_t to = w->found.to[link];
    if ((to & KILN_LINK_LEAF) != 0)
        __builtin_prefetch(&w->p->leaves[to & ~KILN_LINK_LEAF]);
    else
        kiln_link_fetch(w->p, &w->p->nodes[to], to, w->patch[bit]->number);
    w->questions[w->question_count++] = (struct kiln_link_question){link, bit, of};
    return w->question_count == KILN_LINK_QUESTIONS ? ask_all(w, error) : KILN_OK;
}

/* One of the mask's bits, by chance. */
static uint32_t one_of(uint64_t mask, uint32_t hash)
{
    for (uint32_t skip = hash % (uint32_t)__builtin_popcountll(mask); skip > 0; skip--)
        mask &= mask - 1;
    return (uint32_t)__builtin_ctzll(mask);
}

/* Links the points of the mask to a node or a point. Points in `whole` see all of it in front of them, and may share
 * rays. */
static int link_to(struct kiln_link_run *w, uint32_t to, uint64_t mask, uint64_t whole, struct kiln_error *error)
{
    struct kiln_found_links *f = &w->found;
    const uint32_t link = f->count, side = kiln_link_shared_by(w, to);
    const uint64_t sharing = side > 1 ? whole & w->together[side == 16] : 0;
    int status = kiln_found_links_reserve(f, link + 1u, error);
    if (status != KILN_OK)
        return status;
    f->to[link] = to;
    f->asked[link] = mask;
    f->seen[link] = 0;
    f->count++;
    for (uint64_t rest = mask; rest != 0 && status == KILN_OK;) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        uint64_t of = 1ull << bit;
        if ((sharing & of) != 0)
            of = ((1ull << side) - 1) << bit / side * side & sharing & rest;
        rest &= ~of;
        status = note(w, link, one_of(of, kiln_hash2(to, w->patch[bit]->number)), of, error);
    }
    return status;
}

/* Finds links from the root down, children in their order. */
int kiln_link_run_find(struct kiln_link_run *w, struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->p;
    struct {
        uint64_t mask;
        uint32_t to;
    } stack[STACK];
    const double e = kiln_link_run_error(w);
    uint32_t depth = 0;
    int status = KILN_OK;
    w->question_count = 0;
    w->found.count = w->found.tinted_count = 0;
    if (p->node_count > 0)
        stack[depth++].to = 0, stack[0].mask = w->valid | w->shares;
    while (depth > 0 && status == KILN_OK) {
        const uint32_t to = stack[--depth].to;
        const uint64_t mask = stack[depth].mask;
        struct kiln_link_lane_choices c = {.stands = mask};
        if ((to & KILN_LINK_LEAF) == 0)
            c = kiln_link_lanes_judge(&w->lanes, &p->nodes[to], e * e, mask);
        if (c.stands != 0)
            status = link_to(w, to, c.stands, c.whole, error);
        for (uint32_t i = c.open != 0 ? p->nodes[to].children : 0; i > 0; i--)
            stack[depth].mask = c.open, stack[depth++].to = p->nodes[to].child[i - 1];
    }
    return status == KILN_OK ? ask_all(w, error) : status;
}

void kiln_link_run_drop_unseen(struct kiln_link_run *w)
{
    struct kiln_found_links *f = &w->found;
    uint32_t left = 0;
    for (uint32_t i = 0; i < f->count; i++)
        if (f->seen[i] != 0) {
            f->to[left] = f->to[i];
            f->asked[left] = f->asked[i];
            f->seen[left++] = f->seen[i];
        }
    f->count = left;
}

/* ---- answers ---- */

static int add_tinted(struct kiln_link_run *w, uint32_t link, uint64_t of, const double through[3],
                      struct kiln_error *error)
{
    struct kiln_found_links *f = &w->found;
    int status = KILN_OK;
    for (uint64_t rest = of; rest != 0 && status == KILN_OK; rest &= rest - 1) {
        status = kiln_found_links_reserve_tinted(f, f->tinted_count + 1u, error);
        if (status == KILN_OK)
            f->tinted[f->tinted_count++] =
                (struct kiln_tinted_link){f->to[link],
                                          (uint32_t)__builtin_ctzll(rest),
                                          {(float)through[0], (float)through[1], (float)through[2]}};
    }
    return status;
}

int kiln_link_run_see(struct kiln_link_run *w, uint32_t link, uint64_t of, const double through[3],
                      struct kiln_error *error)
{
    if (through[0] != 1.0 || through[1] != 1.0 || through[2] != 1.0)
        return add_tinted(w, link, of, through, error);
    w->found.seen[link] |= of;
    return KILN_OK;
}
