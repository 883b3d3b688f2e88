/* The links pass (worker/pass/links.h). For tile runs whose links are not kept all points go down the tree together, a
 * bit each, and shadow rays go to what they stop at, eight at a time; then sums are of what is kept alone. Points are
 * known by their bits in the tile. */
#include "worker/pass/links.h"

#include <math.h>
#include <string.h>

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/link_lanes.h"
#include "worker/backend/embree/patch_ray.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"

#define ALIKE 0.5        /* cosine between normals of points that share a ray */
#define TOGETHER 1.25    /* texels, over the points in a row: how far apart those are */
#define LEAST_OPENED 8.0 /* links are opened to so many-th of the error that is asked for */
/* What light that varies over a node is off by, over the radii in its distance times the deviation. */
#define SPREAD 1.5

enum { STACK = 512, ASKS = 32, AHEAD = 4 };

/* What the pass's threads share. */
struct links_job {
    const struct kiln_links_parameters *p;
    const struct kiln_batch *part;
    const struct kiln_point_result *gathered; /* of the part's points: what their rays meet */
    int status;                               /* of the thread that has failed */
    struct kiln_error *error;
};

/* A ray that is to be traced: link `link` of the points of the mask. */
struct link_ray {
    uint32_t link;
    uint64_t of;
};

/* One before it: from the point at `bit` to point `to` of the tree. */
struct link_ask {
    uint32_t link, bit, to;
    uint64_t of;
};

struct links_work {
    struct tile_run_frame frame;
    struct links_job *job;
    /* points of the tile run, and those of them that have light; those of the whole tile that send some, which share
     * rays, and say by what they see how sure that is */
    uint64_t mask, valid, shares;
    uint64_t together[2];             /* of `shares`, those whose squares of 2 x 2 and of 4 x 4 lie together */
    double error;                     /* that links are opened to */
    double texel;                     /* m: the longest edge of a point */
    bool by_first;                    /* errors are of first light */
    uint8_t bit[KILN_TILE_TEXELS];    /* of the points, by their places in the run */
    uint64_t index[KILN_TILE_TEXELS]; /* global, by bit, as all below */
    struct patch_receiver receiver[KILN_TILE_TEXELS];
    struct kiln_dvec3 at[KILN_TILE_TEXELS];
    const struct kiln_patch *patch[KILN_TILE_TEXELS];
    struct link_lanes lanes; /* of the same points */
    struct link_lane_sums sums;
    struct link_lane_factors factors;
    bool summed; /* these sums are of the links found, and of this bounce */
    struct kiln_found_links found;
    struct RTCRay8 rays __attribute__((aligned(32)));
    int valid_rays[PACKET] __attribute__((aligned(32)));
    struct link_ray of[PACKET];
    uint32_t waiting;
    struct link_ask asks[ASKS]; /* of which what they go to is on its way from memory */
    uint32_t asked;
    uint64_t traced;
};

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b, (void)part;
    struct links_work *w = NULL;
    const int status = kiln_allocate(&w, 1, sizeof *w, "the links pass", error);
    if (status == KILN_OK)
        w->job = *(struct links_job *const *)parameters;
    *work = w;
    return status;
}

static void work_destroy(void **work)
{
    struct links_work *w = *work;
    if (w == NULL)
        return;
    kiln_found_links_release(&w->found);
    kiln_free(work);
}

static bool has_failed(const struct links_job *job)
{
    int status;
#pragma omp atomic read
    status = job->status;
    return status != KILN_OK;
}

static void fail(struct links_job *job, int status, const struct kiln_error *error)
{
#pragma omp critical(kiln_links_status)
    if (job->status == KILN_OK) {
        (void)kiln_fail(job->error, status, "%s", error->message);
#pragma omp atomic write
        job->status = status;
    }
}

/* ---- finding links ---- */

static int add_tinted(struct links_work *w, const struct link_ray *ray, const double through[3],
                      struct kiln_error *error)
{
    struct kiln_found_links *f = &w->found;
    int status = KILN_OK;
    for (uint64_t rest = ray->of; rest != 0 && status == KILN_OK; rest &= rest - 1) {
        status = kiln_found_links_reserve_tinted(f, f->tinted_count + 1u, error);
        if (status == KILN_OK)
            f->tinted[f->tinted_count++] =
                (struct kiln_tinted_link){f->to[ray->link],
                                          (uint32_t)__builtin_ctzll(rest),
                                          {(float)through[0], (float)through[1], (float)through[2]}};
    }
    return status;
}

static int trace(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                 struct kiln_error *error)
{
    double through[PACKET][3];
    int status = KILN_OK;
    for (uint32_t i = 0; i < PACKET; i++) {
        w->valid_rays[i] = i < w->waiting ? -1 : 0;
        through[i][0] = through[i][1] = through[i][2] = 1.0;
    }
    if (w->waiting > 0)
        embree_through8(b, context, w->valid_rays, &w->rays, through);
    for (uint32_t i = 0; i < w->waiting && status == KILN_OK; i++) {
        if (w->rays.tfar[i] < 0.0f)
            continue;
        if (through[i][0] == 1.0 && through[i][1] == 1.0 && through[i][2] == 1.0)
            w->found.seen[w->of[i].link] |= w->of[i].of;
        else
            status = add_tinted(w, &w->of[i], through[i], error);
    }
    w->traced += w->waiting;
    w->waiting = 0;
    return status;
}

/* Makes a ray of what is asked, if the two face each other. */
static int send(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                const struct link_ask *a, struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->job->p;
    const struct kiln_patch *own = w->patch[a->bit], *other = &p->points[p->order[a->to]];
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(other->centre), w->at[a->bit]);
    const bool first = own->number < other->number;
    if (!(dvec3_dot(w->receiver[a->bit].n, d) > 0.0 && dvec3_dot(dvec3_of(other->normal), d) < 0.0))
        return KILN_OK;
    if (!patch_ray(&w->rays, w->waiting, first ? own->place : other->place, first ? other->place : own->place))
        return KILN_OK;
    w->of[w->waiting++] = (struct link_ray){a->link, a->of};
    return w->waiting == PACKET ? trace(w, b, context, error) : KILN_OK;
}

static int send_all(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                    struct kiln_error *error)
{
    int status = KILN_OK;
    for (uint32_t i = 0; i < w->asked && status == KILN_OK; i++)
        status = send(w, b, context, &w->asks[i], error);
    w->asked = 0;
    return status;
}

/* Asks whether the point at `bit` sees what link `link` goes to, for the points `of`. */
static int ask(struct links_work *w, const struct embree_backend *b, struct embree_context *context, uint32_t link,
               uint32_t bit, uint64_t of, struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->job->p;
    const uint32_t to = w->found.to[link];
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const uint32_t k = leaf ? to & ~KILN_LINK_LEAF : kiln_link_choose(p, &p->nodes[to], to, w->patch[bit]->number);
    kiln_link_fetch(p, k);
    w->asks[w->asked++] = (struct link_ask){link, bit, k, of};
    return w->asked == ASKS ? send_all(w, b, context, error) : KILN_OK;
}

/* How many points in a row, a square of them, have one ray to a node: worker/pass/links.h. */
static uint32_t shared_by(const struct links_work *w, uint32_t to)
{
    const double radius = (to & KILN_LINK_LEAF) != 0 ? 0.0 : KILN_LINKS_SHARED * (double)w->job->p->nodes[to].radius;
    return 4.0 * w->texel <= radius ? 16 : 2.0 * w->texel <= radius ? 4 : 1;
}

/* One of the mask's bits, by chance. */
static uint32_t one_of(uint64_t mask, uint32_t hash)
{
    for (uint32_t skip = hash % (uint32_t)__builtin_popcountll(mask); skip > 0; skip--)
        mask &= mask - 1;
    return (uint32_t)__builtin_ctzll(mask);
}

/* Links the points of the mask to a node or a point; those of `whole` have it whole before them, and may share rays. */
static int link_to(struct links_work *w, const struct embree_backend *b, struct embree_context *context, uint32_t to,
                   uint64_t mask, uint64_t whole, struct kiln_error *error)
{
    struct kiln_found_links *f = &w->found;
    const uint32_t link = f->count, side = shared_by(w, to);
    int status = kiln_found_links_reserve(f, link + 1u, error);
    if (status != KILN_OK)
        return status;
    f->to[link] = to;
    f->asked[link] = mask;
    f->seen[link] = 0;
    f->count++;
    for (uint64_t rest = mask; rest != 0 && status == KILN_OK;) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const uint64_t sharing = side > 1 ? whole & w->together[side == 16] : 0;
        uint64_t of = 1ull << bit;
        if ((sharing & of) != 0)
            of = ((1ull << side) - 1) << bit / side * side & sharing & rest;
        rest &= ~of;
        status = ask(w, b, context, link, one_of(of, kiln_hash2(to, w->patch[bit]->number)), of, error);
    }
    return status;
}

/* From the root down, children in their order. */
static int find_links(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                      struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->job->p;
    struct {
        uint64_t mask;
        uint32_t to;
    } stack[STACK];
    uint32_t depth = 0;
    int status = KILN_OK;
    w->waiting = w->asked = 0;
    w->found.count = w->found.tinted_count = 0;
    if (p->node_count > 0)
        stack[depth++].to = 0, stack[0].mask = w->valid | w->shares;
    while (depth > 0 && status == KILN_OK) {
        const uint32_t to = stack[--depth].to;
        const uint64_t mask = stack[depth].mask;
        struct link_lane_choices c = {.stands = mask};
        if ((to & KILN_LINK_LEAF) == 0)
            c = link_lanes_judge(&w->lanes, &p->nodes[to], w->error * w->error, mask);
        if (c.stands != 0)
            status = link_to(w, b, context, to, c.stands, c.whole, error);
        for (uint32_t i = c.open != 0 ? p->nodes[to].children : 0; i > 0; i--)
            stack[depth].mask = c.open, stack[depth++].to = p->nodes[to].child[i - 1];
    }
    if (status == KILN_OK)
        status = send_all(w, b, context, error);
    return status == KILN_OK ? trace(w, b, context, error) : status;
}

/* Links that nobody sees anything by go. */
static void drop_unseen(struct kiln_found_links *f)
{
    uint32_t left = 0;
    for (uint32_t i = 0; i < f->count; i++)
        if (f->seen[i] != 0) {
            f->to[left] = f->to[i];
            f->asked[left] = f->asked[i];
            f->seen[left++] = f->seen[i];
        }
    f->count = left;
}

/* ---- points ---- */

static void enter_lane(double lanes[3][KILN_TILE_TEXELS], uint32_t bit, struct kiln_dvec3 v)
{
    lanes[0][bit] = v.x, lanes[1][bit] = v.y, lanes[2][bit] = v.z;
}

static void enter_point(struct links_work *w, uint32_t bit, uint64_t index)
{
    const struct kiln_patch *patch = &w->job->p->points[index];
    w->index[bit] = index;
    w->patch[bit] = patch;
    w->at[bit] = dvec3_of(patch->place);
    w->receiver[bit] = (struct patch_receiver){dvec3_of(patch->normal), dvec3_of(patch->normal), false};
    enter_lane(w->lanes.at, bit, w->at[bit]);
    enter_lane(w->lanes.n, bit, w->receiver[bit].n);
    enter_lane(w->lanes.s, bit, w->receiver[bit].n);
    if (!(patch->area > 0.0f))
        return;
    w->shares |= 1ull << bit;
    w->texel = fmax(
        w->texel, sqrt((double)fmaxf(vec3_dot(patch->edge_s, patch->edge_s), vec3_dot(patch->edge_t, patch->edge_t))));
}

/* Whether points that share a ray are in one place, and look much the same way: not those of two charts. */
static bool lie_together(const struct links_work *w, uint64_t points, double within)
{
    const uint32_t lead = (uint32_t)__builtin_ctzll(points);
    for (uint64_t rest = points & (points - 1); rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const struct kiln_dvec3 d = dvec3_sub(w->at[bit], w->at[lead]);
        if (dvec3_dot(d, d) > within * within || dvec3_dot(w->receiver[bit].n, w->receiver[lead].n) < ALIKE)
            return false;
    }
    return true;
}

static void find_together(struct links_work *w)
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

/* The points of the run, and others of its tile, as their patches are: what is shared must not hang on cells. */
static void enter_points(struct links_work *w, const struct kiln_surface *s, const struct kiln_tile_run *run)
{
    const struct kiln_tile *tile = &s->tiles[s->lightmaps[run->map].tile_first + run->tile];
    uint32_t place = 0;
    w->mask = run->mask;
    w->shares = 0;
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

/* Their shading normals, and which have light. */
static void enter_found(struct links_work *w)
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

/* What the points' rays have met, and their normals as the frame has them. */
static void find_points(struct links_work *w, const struct embree_backend *b, size_t tile_run,
                        const struct kiln_point_result *gathered)
{
    frame_build(&w->frame, b, tile_run, UINT64_MAX, 0);
    memset(w->found.point, 0, sizeof w->found.point);
    w->found.smooth = w->frame.smooth;
    for (uint32_t j = 0; j < w->frame.count; j++) {
        const uint32_t bit = w->bit[w->frame.place[j]];
        const struct kiln_point_result *g = &gathered[w->frame.place[j]];
        const struct kiln_vec3 s = frame_shading(&w->frame, j, w->patch[bit]->normal);
        w->found.point[bit] = (struct kiln_linked_point){.escaped = g->escaped,
                                                         .blocked = g->blocked,
                                                         .glass = {g->glass[0], g->glass[1], g->glass[2]},
                                                         .present = g->present,
                                                         .count = g->count};
        w->found.shading[bit][0] = s.x, w->found.shading[bit][1] = s.y, w->found.shading[bit][2] = s.z;
    }
    enter_found(w);
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

static struct unsure unsure_of(const struct links_work *w, uint32_t link)
{
    const uint32_t side = shared_by(w, w->found.to[link]);
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

/* The variance of what the points of the mask see. */
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

/* The light that errors are of: so far and before this bounce; or the first, over its mean. */
static struct kiln_link_light light_of(const struct links_work *w, uint32_t to)
{
    const struct kiln_links_parameters *p = w->job->p;
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const uint32_t at = to & ~KILN_LINK_LEAF;
    if (!w->by_first)
        return leaf ? p->leaf_light[at] : p->light[at];
    if (leaf)
        return (struct kiln_link_light){.now = p->first[p->order[at]]};
    const struct kiln_link_node *node = &p->nodes[at];
    return (struct kiln_link_light){.now = node->level, .spread_now = node->spread * node->spread};
}

/* Factors of a link of the points of the mask. */
static void find_factors(struct links_work *w, uint32_t to, uint64_t mask)
{
    const struct kiln_links_parameters *p = w->job->p;
    struct link_lane_factors *f = &w->factors;
    f->whole = 0;
    if ((to & KILN_LINK_LEAF) == 0)
        link_lanes_factors(&w->lanes, &p->nodes[to], mask, f);
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const double area = leaf ? 0.0 : (double)p->nodes[to].area;
    uint32_t k[KILN_TILE_TEXELS];
    for (uint64_t rest = mask & ~f->whole; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        k[bit] = leaf ? to & ~KILN_LINK_LEAF : kiln_link_choose(p, &p->nodes[to], to, w->patch[bit]->number);
        kiln_link_fetch(p, k[bit]);
    }
    for (uint64_t rest = mask & ~f->whole; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        struct patch_factors one = {0.0, 0.0};
        (void)kiln_patch_factors_of(&w->receiver[bit], w->at[bit], &p->points[p->order[k[bit]]], area, &one);
        f->factor[bit] = one.factor;
        f->shading[bit] = one.shading;
    }
}

/* A link to `to` of which so much is let through; nobody has it yet. */
static void begin_link(const struct links_work *w, uint32_t to, const float through[3], struct link_lane_link *link)
{
    const struct kiln_links_parameters *p = w->job->p;
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const float *radiosity = leaf ? p->leaf_radiosity[to & ~KILN_LINK_LEAF] : p->radiosity[to];
    const struct kiln_link_light l = light_of(w, to);
    const double now = (double)l.now, before = (double)l.before;
    link->sees = link->other = 0;
    link->through = ((double)through[0] + (double)through[1] + (double)through[2]) / 3.0;
    link->now = now;
    link->more = (double)l.spread_now - (double)l.spread_before;
    link->square = now * now - before * before + link->more;
    link->reach = leaf || !(link->through > 0.0) ? 0.0 : SPREAD * (double)p->nodes[to].radius;
    link->by_first = w->by_first;
    for (int c = 0; c < 3; c++)
        link->light[c] = (double)radiosity[c] * (double)through[c];
}

/* What the points `of` gather by a link that was found; points that see nothing by it, though some beside them do, are
 * not sure of that. */
static void add_found(struct links_work *w, uint32_t i, uint64_t of)
{
    static const float all[3] = {1.0f, 1.0f, 1.0f};
    const struct kiln_found_links *f = &w->found;
    const struct unsure u = unsure_of(w, i);
    struct link_lane_link link;
    begin_link(w, f->to[i], all, &link);
    link.sees = f->seen[i] & f->asked[i] & of;
    link.other = (u.other[0] | u.other[1] | u.other[2]) & f->asked[i] & of & ~f->seen[i];
    find_unsure(&u, link.sees | link.other, link.unsure);
    find_factors(w, f->to[i], link.sees | link.other);
    link_lanes_add(&w->sums, &w->factors, &link);
}

static void add_tinted_link(struct links_work *w, const struct kiln_tinted_link *t)
{
    struct link_lane_link link;
    begin_link(w, t->to, t->through, &link);
    link.sees = 1ull << t->bit;
    link.unsure[t->bit] = 0.0;
    find_factors(w, t->to, link.sees);
    link_lanes_add(&w->sums, &w->factors, &link);
}

static void add_links(struct links_work *w)
{
    const struct kiln_found_links *f = &w->found;
    const uint64_t of = w->by_first ? w->shares : w->valid;
    w->summed = !w->by_first;
    memset(&w->sums, 0, sizeof w->sums);
    for (uint32_t i = 0; i < f->count; i++) {
        if (i + AHEAD < f->count && (f->to[i + AHEAD] & KILN_LINK_LEAF) != 0)
            kiln_link_fetch(w->job->p, f->to[i + AHEAD] & ~KILN_LINK_LEAF);
        add_found(w, i, of);
    }
    for (uint32_t i = 0; i < f->tinted_count; i++)
        if ((of >> f->tinted[i].bit & 1) != 0)
            add_tinted_link(w, &f->tinted[i]);
}

static void find_scales(struct links_work *w)
{
    for (uint64_t rest = w->valid; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        struct kiln_linked_point *l = &w->found.point[bit];
        const struct kiln_point_result met = {.escaped = l->escaped,
                                              .blocked = l->blocked,
                                              .glass = {l->glass[0], l->glass[1], l->glass[2]},
                                              .count = l->count};
        l->scale = (float)kiln_patches_row_scale(&met, w->sums.row[bit]);
    }
}

static double luminance_of(const double lanes[3][KILN_TILE_TEXELS], uint32_t bit)
{
    return kiln_luminance((const double[3]){lanes[0][bit], lanes[1][bit], lanes[2][bit]});
}

/* Standard error of the luminance of irradiance, as that is closed. */
static double error_of(const struct links_work *w, uint32_t bit)
{
    const struct link_lane_sums *s = &w->sums;
    const double scale = (double)w->found.point[bit].scale, irradiance = luminance_of(s->irradiance, bit),
                 closed = kiln_patches_closed(scale, luminance_of(s->incident, bit), irradiance);
    return (irradiance > 0.0 ? closed / irradiance : scale) * sqrt(fmax(0.0, w->sums.variance[bit]));
}

static void give(const struct links_work *w, uint32_t points, struct kiln_point_result *results)
{
    for (uint32_t i = 0; i < points; i++) {
        const uint32_t bit = w->bit[i];
        const struct kiln_linked_point *point = &w->found.point[bit];
        const double count = (double)point->count, scale = (double)point->scale * count;
        struct kiln_point_result *r = &results[i];
        if (point->count == 0)
            continue;
        *r = (struct kiln_point_result){.escaped = point->escaped,
                                        .blocked = point->blocked,
                                        .glass = {point->glass[0], point->glass[1], point->glass[2]},
                                        .present = point->present,
                                        .count = point->count,
                                        .error = (float)(count * error_of(w, bit))};
        for (int c = 0; c < 3; c++) {
            const double incident = w->sums.incident[c][bit], irradiance = w->sums.irradiance[c][bit];
            r->incident[c] = (float)(scale * incident);
            r->irradiance[c] = (float)(count * kiln_patches_closed((double)point->scale, incident, irradiance));
        }
    }
}

/* ---- tile runs ---- */

/* Finds the tile run's links, for the error of the work, and closes its rows. */
static int find_run(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                    struct kiln_error *error)
{
    const int status = find_links(w, b, context, error);
    if (status != KILN_OK)
        return status;
    drop_unseen(&w->found);
    add_links(w);
    find_scales(w);
    return KILN_OK;
}

/* Whether the errors that first light has by the links found, in the root of their mean square over the tile's points,
 * are above the target. */
static bool is_above_target(struct links_work *w)
{
    const struct kiln_links_parameters *p = w->job->p;
    double square = 0.0;
    w->by_first = true;
    add_links(w);
    w->by_first = false;
    for (uint64_t rest = w->shares; rest != 0; rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const double light = (double)p->first[w->index[bit]] + w->sums.now[bit],
                     allowed = p->target * fmax(light, KILN_LINKS_LEAST_LIGHT);
        square += fmax(0.0, w->sums.variance[bit]) / (allowed * allowed);
    }
    return square > (double)__builtin_popcountll(w->shares);
}

/* Opens links until the target is reached; *opened: some were. */
static int open_run(struct links_work *w, const struct embree_backend *b, struct embree_context *context, bool *opened,
                    struct kiln_error *error)
{
    const double least = w->job->p->error / LEAST_OPENED;
    int status = KILN_OK;
    *opened = false;
    for (w->error = w->job->p->error; 0.5 * w->error >= least && is_above_target(w) && status == KILN_OK;) {
        w->error *= 0.5;
        *opened = true;
        status = find_run(w, b, context, error);
    }
    return status;
}

/* Finds what is not kept. */
static int make_run(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                    size_t tile_run, struct kiln_error *error)
{
    const struct kiln_tile_run *runs = b->surface->tile_runs, *run = &runs[tile_run];
    find_points(w, b, tile_run, w->job->gathered + (run->first.at - runs[w->job->part->first].first.at));
    w->error = w->job->p->error;
    return find_run(w, b, context, error);
}

static int take_kept(struct links_work *w, const struct kiln_tile_run *run, const struct kiln_kept_links *kept,
                     struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->job->p;
    const int status = kiln_links_decode(&w->found, kept, run->mask, w->shares, p->node_count, p->count, error);
    if (status == KILN_OK)
        enter_found(w);
    return status;
}

/* Keeps what has been found. */
static int keep(const struct links_work *w, const struct kiln_tile_run *run, struct kiln_kept_links **kept,
                struct kiln_error *error)
{
    struct kiln_kept_links *old = *kept;
    const int status = kiln_links_encode(kept, &w->found, run->first.at, run->mask, w->shares, error);
    kiln_free(&old);
    return status;
}

/* The tile run's links, as they are kept or found, and opened; then the sums. */
static int do_run(struct links_work *w, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                  struct kiln_error *error)
{
    const struct kiln_tile_run *run = &b->surface->tile_runs[tile_run];
    struct kiln_kept_links **kept = w->job->p->kept != NULL ? &w->job->p->kept[tile_run] : NULL;
    const bool is_kept = kept != NULL && *kept != NULL, is_judged = is_kept && (*kept)->is_judged != 0;
    bool opened = false;
    enter_points(w, b->surface, run);
    w->summed = false;
    int status = is_kept ? take_kept(w, run, *kept, error) : make_run(w, b, context, tile_run, error);
    if (status == KILN_OK && w->job->p->target > 0.0 && !is_judged)
        status = open_run(w, b, context, &opened, error);
    if (status == KILN_OK && kept != NULL && (!is_kept || opened))
        status = keep(w, run, kept, error);
    if (status != KILN_OK)
        return status;
    if (kept != NULL)
        (*kept)->is_judged = 1;
    if (!w->summed)
        add_links(w);
    return KILN_OK;
}

static void links_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                           void *results, uint64_t *rays)
{
    struct links_work *w = work;
    struct kiln_error error;
    if (has_failed(w->job))
        return;
    w->traced = 0;
    const int status = do_run(w, b, context, tile_run, &error);
    if (status != KILN_OK) {
        fail(w->job, status, &error);
        return;
    }
    give(w, b->surface->tile_runs[tile_run].count, results);
    *rays += w->traced;
}

/* Which tile runs of the part have no links yet: their samples, 0 of the others. False: all have. */
static bool are_missing(const struct kiln_links_parameters *p, const struct kiln_batch *part, uint32_t *samples)
{
    bool any = false;
    for (size_t i = 0; i < part->count; i++) {
        const bool kept = p->kept != NULL && p->kept[part->first + i] != NULL;
        samples[i] = kept || kiln_batch_leaves_out(part, part->first + i) ? 0 : part->samples;
        any = any || samples[i] > 0;
    }
    return any;
}

int embree_links(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                 uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, links_tile_run,
                                              sizeof(struct kiln_point_result)};
    const struct kiln_links_parameters *p = parameters;
    const struct kiln_tile_run *runs = b->surface->tile_runs + part->first;
    struct kiln_point_result *gathered = NULL;
    uint32_t *samples = NULL;
    struct kiln_batch missing = *part;
    int status = kiln_allocate(&gathered, (size_t)kiln_tile_runs_points(runs, runs + part->count - 1), sizeof *gathered,
                               "what the rays of links meet", error);
    if (status == KILN_OK)
        status = kiln_allocate(&samples, part->count, sizeof *samples, "the links that are missing", error);
    missing.samples_each = samples;
    missing.stream = p->stream;
    if (status == KILN_OK && are_missing(p, part, samples))
        status = embree_gather(b, NULL, &missing, gathered, rays, error);
    struct links_job job = {p, part, gathered, KILN_OK, error}, *shared = &job;
    if (status == KILN_OK)
        status = embree_each_tile_run(b, &pass, &shared, part, results, rays, error);
    kiln_free(&samples);
    kiln_free(&gathered);
    return status == KILN_OK ? job.status : status;
}
