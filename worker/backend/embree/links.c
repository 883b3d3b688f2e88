/* The links pass (worker/pass/links.h). For tile runs whose links are not kept all points go down the tree together, a
 * bit each, and shadow rays go to what they stop at, eight at a time; then sums are of what is kept alone. */
#include "worker/pass/links.h"

#include <math.h>
#include <string.h>

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/patch_factors.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"

#define NEAREST 2.0       /* radii from which a node may be linked to */
#define LEAST_FACTOR 1e-3 /* over the square of the error: nodes below are left out */
#define FLAT 1e-5         /* what of a cosine is rounding */

enum { DRAWS = 4, STACK = 512 };

/* What the pass's threads share. */
struct links_job {
    const struct kiln_links_parameters *p;
    const struct kiln_batch *part;
    const struct kiln_point_result *gathered; /* of the part's points: what their rays meet */
    int status;                               /* of the thread that has failed */
    struct kiln_error *error;
};

/* A ray that is to be traced: link `link` of the point at `place`. */
struct link_ray {
    uint32_t link, place;
};

struct links_work {
    struct tile_run_frame frame;
    struct links_job *job;
    /* of the tile run's points, by place */
    struct patch_receiver receiver[KILN_TILE_TEXELS];
    struct kiln_dvec3 at[KILN_TILE_TEXELS];
    const struct kiln_patch *patch[KILN_TILE_TEXELS];
    double row[KILN_TILE_TEXELS], incident[KILN_TILE_TEXELS][3], irradiance[KILN_TILE_TEXELS][3];
    /* links that are being found */
    struct kiln_kept_links found;
    size_t room_to, room_seen, room_tinted;
    struct RTCRay8 rays __attribute__((aligned(32)));
    int valid[PACKET] __attribute__((aligned(32)));
    struct link_ray of[PACKET];
    uint32_t waiting;
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
    kiln_free(&w->found.to);
    kiln_free(&w->found.seen);
    kiln_free(&w->found.tinted);
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

/* ---- factors ---- */

/* How a point sees a node. */
struct node_view {
    struct kiln_dvec3 d;
    double square, distance, other; /* other: -d about the node's normal */
    double height, reach;           /* the highest that it may stand over the point's horizon; and the point over its */
    bool whole;                     /* all of it is above the horizon and faces the point */
};

static struct node_view view_of(const struct links_work *w, uint32_t place, const struct kiln_link_node *node)
{
    const struct kiln_dvec3 n = w->receiver[place].n, d = dvec3_sub(dvec3_of(node->centre), w->at[place]);
    struct node_view v = {.d = d, .square = dvec3_dot(d, d), .other = -dvec3_dot(dvec3_of(node->normal), d)};
    v.distance = sqrt(v.square);
    const double radius = (double)node->radius, height = dvec3_dot(n, d),
                 off = (double)node->height + (double)node->bend * (v.distance + radius);
    v.height = height + radius;
    v.reach = v.other + off;
    v.whole = height >= radius && v.other >= off;
    return v;
}

/* n.d / |d|^4, in the mean over the node's surface, over |d|^-4 at its centre: to the second order. */
static double mean_height(const struct kiln_link_node *node, struct kiln_dvec3 n, const struct node_view *v)
{
    const float *c = node->covariance;
    const struct kiln_dvec3 d = v->d, along = dvec3((double)c[0] * d.x + (double)c[3] * d.y + (double)c[4] * d.z,
                                                    (double)c[3] * d.x + (double)c[1] * d.y + (double)c[5] * d.z,
                                                    (double)c[4] * d.x + (double)c[5] * d.y + (double)c[2] * d.z);
    const double height = dvec3_dot(n, d), trace = (double)c[0] + (double)c[1] + (double)c[2];
    return fmax(0.0,
                height + (height * (12.0 * dvec3_dot(d, along) / v->square - 2.0 * trace) - 4.0 * dvec3_dot(n, along)) /
                             v->square);
}

/* The point of the node that the view of the point at `place` is taken by: its place in the tree's order. A sequence
 * over the points' numbers, by the golden ratio; points of less area than others are taken less often. */
static uint32_t choose(const struct links_work *w, uint32_t place, const struct kiln_link_node *node, uint32_t number)
{
    const struct kiln_links_parameters *p = w->job->p;
    const uint32_t hash = kiln_hash1(number);
    double u = (double)hash * 0x1p-32 + (double)w->patch[place]->number * 0.61803398874989485;
    uint32_t k = node->first;
    for (uint32_t draw = 0; draw < DRAWS; draw++) {
        u -= floor(u);
        k = node->first + (uint32_t)(u * (double)node->count);
        const double chance = (double)kiln_hash2(hash + draw, w->patch[place]->number) * 0x1p-32;
        if (chance * (double)node->most_area < (double)p->points[p->order[k]].area)
            break;
        u += 0.75487766624669276;
    }
    return k;
}

/* Of the surface of a patch with this area in the place of its own. False: one does not see the other. */
static bool patch_factors_of(const struct patch_receiver *receiver, struct kiln_dvec3 at, const struct kiln_patch *from,
                             double area, struct patch_factors *f)
{
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(from->centre), at);
    const double cosine = dvec3_dot(receiver->n, d), other = -dvec3_dot(dvec3_of(from->normal), d),
                 square = dvec3_dot(d, d);
    if (!(cosine > 0.0 && other > 0.0))
        return false;
    if (area > 0.0) {
        const double far = area * other / (KILN_PI * square * square);
        *f = (struct patch_factors){far * cosine, far * fmax(0.0, dvec3_dot(receiver->s, d))};
    } else {
        *f = patch_factors(receiver, from, d, square, cosine, other);
    }
    return true;
}

/* F of a link of the point at `place`. */
static struct patch_factors link_factors(const struct links_work *w, uint32_t place, uint32_t to)
{
    const struct kiln_links_parameters *p = w->job->p;
    const struct patch_receiver *receiver = &w->receiver[place];
    struct patch_factors f = {0.0, 0.0};
    if ((to & KILN_LINK_LEAF) != 0) {
        (void)patch_factors_of(receiver, w->at[place], &p->points[p->order[to & ~KILN_LINK_LEAF]], 0.0, &f);
        return f;
    }
    const struct kiln_link_node *node = &p->nodes[to];
    const struct node_view v = view_of(w, place, node);
    if (v.whole) {
        const double far = (double)node->area * v.other / (KILN_PI * v.square * v.square);
        f.factor = far * mean_height(node, receiver->n, &v);
        f.shading = receiver->smooth ? far * mean_height(node, receiver->s, &v) : f.factor;
    } else {
        const struct kiln_patch *from = &p->points[p->order[choose(w, place, node, to)]];
        (void)patch_factors_of(receiver, w->at[place], from, (double)node->area, &f);
    }
    return f;
}

/* ---- finding links ---- */

enum link_choice { LINK_NONE, LINK_OPEN, LINK_STANDS };

/* What the point at `place` does with a node. */
static enum link_choice judge(const struct links_work *w, uint32_t place, const struct kiln_link_node *node)
{
    const struct node_view v = view_of(w, place, node);
    const double square_error = w->job->p->error * w->job->p->error, radius = (double)node->radius;
    if (!(v.height > 0.0 && v.reach > FLAT * (v.distance + radius)))
        return LINK_NONE;
    if (v.distance < NEAREST * radius)
        return LINK_OPEN;
    const double factor = (double)node->area * fmin(1.0, v.height / v.distance) * fmin(1.0, v.reach / v.distance) /
                          (KILN_PI * v.square),
                 rho = radius / v.distance, turned = 2.0 * rho * (double)node->bend,
                 spread = 1.5 * rho * (double)node->spread, light = 1.0 + (double)node->level,
                 unsure = v.whole ? KILN_LINKS_UNSEEN + turned * turned : 1.0;
    if (factor < LEAST_FACTOR * square_error)
        return LINK_NONE;
    return factor * (unsure * light * light + spread * spread) <= square_error * light ? LINK_STANDS : LINK_OPEN;
}

static int add_tinted(struct links_work *w, uint32_t link, uint32_t place, const double through[3],
                      struct kiln_error *error)
{
    struct kiln_kept_links *f = &w->found;
    const int status =
        kiln_grow(&f->tinted, &w->room_tinted, f->tinted_count + 1u, sizeof *f->tinted, "tinted links", error);
    if (status == KILN_OK)
        f->tinted[f->tinted_count++] =
            (struct kiln_tinted_link){f->to[link], place, {(float)through[0], (float)through[1], (float)through[2]}};
    return status;
}

static int trace(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                 struct kiln_error *error)
{
    double through[PACKET][3];
    int status = KILN_OK;
    for (uint32_t i = 0; i < PACKET; i++) {
        w->valid[i] = i < w->waiting ? -1 : 0;
        through[i][0] = through[i][1] = through[i][2] = 1.0;
    }
    if (w->waiting > 0)
        embree_through8(b, context, w->valid, &w->rays, through);
    for (uint32_t i = 0; i < w->waiting && status == KILN_OK; i++) {
        const struct link_ray *of = &w->of[i];
        if (w->rays.tfar[i] < 0.0f)
            continue;
        if (through[i][0] == 1.0 && through[i][1] == 1.0 && through[i][2] == 1.0)
            w->found.seen[of->link] |= 1ull << of->place;
        else
            status = add_tinted(w, of->link, of->place, through[i], error);
    }
    w->traced += w->waiting;
    w->waiting = 0;
    return status;
}

/* Asks whether the point at `place` sees what link `link` goes to. */
static int ask(struct links_work *w, const struct embree_backend *b, struct embree_context *context, uint32_t link,
               uint32_t place, struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->job->p;
    const uint32_t to = w->found.to[link];
    const bool leaf = (to & KILN_LINK_LEAF) != 0;
    const uint32_t k = leaf ? to & ~KILN_LINK_LEAF : choose(w, place, &p->nodes[to], to);
    const struct kiln_patch *own = w->patch[place], *other = &p->points[p->order[k]];
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(other->centre), w->at[place]);
    const bool first = own->number < other->number;
    if (!(dvec3_dot(w->receiver[place].n, d) > 0.0 && dvec3_dot(dvec3_of(other->normal), d) < 0.0))
        return KILN_OK;
    if (!patch_ray(&w->rays, w->waiting, first ? own->place : other->place, first ? other->place : own->place))
        return KILN_OK;
    w->of[w->waiting++] = (struct link_ray){link, place};
    return w->waiting == PACKET ? trace(w, b, context, error) : KILN_OK;
}

/* Links the points of the mask to a node or a point. */
static int link_to(struct links_work *w, const struct embree_backend *b, struct embree_context *context, uint32_t to,
                   uint64_t mask, struct kiln_error *error)
{
    struct kiln_kept_links *f = &w->found;
    const uint32_t link = f->count;
    int status = kiln_grow(&f->to, &w->room_to, link + 1u, sizeof *f->to, "the links of a tile", error);
    if (status == KILN_OK)
        status = kiln_grow(&f->seen, &w->room_seen, link + 1u, sizeof *f->seen, "the links of a tile", error);
    if (status != KILN_OK)
        return status;
    f->to[link] = to;
    f->seen[link] = 0;
    f->count++;
    for (uint64_t rest = mask; rest != 0 && status == KILN_OK; rest &= rest - 1)
        status = ask(w, b, context, link, (uint32_t)__builtin_ctzll(rest), error);
    return status;
}

/* Of the points of the mask, those that stop at the node, in *stands, and those that go on to its children. */
static uint64_t judge_all(const struct links_work *w, const struct kiln_link_node *node, uint64_t mask,
                          uint64_t *stands)
{
    uint64_t open = 0;
    *stands = 0;
    for (uint64_t rest = mask; rest != 0; rest &= rest - 1) {
        const uint32_t place = (uint32_t)__builtin_ctzll(rest);
        const enum link_choice choice = judge(w, place, node);
        open |= (uint64_t)(choice == LINK_OPEN) << place;
        *stands |= (uint64_t)(choice == LINK_STANDS) << place;
    }
    return open;
}

/* From the root down, children in their order. */
static int find_links(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                      uint64_t valid, struct kiln_error *error)
{
    const struct kiln_links_parameters *p = w->job->p;
    struct {
        uint64_t mask;
        uint32_t to;
    } stack[STACK];
    uint32_t depth = 0;
    int status = KILN_OK;
    if (p->node_count > 0)
        stack[depth++].to = 0, stack[0].mask = valid;
    while (depth > 0 && status == KILN_OK) {
        const uint32_t to = stack[--depth].to;
        const uint64_t mask = stack[depth].mask;
        uint64_t stands = mask, open = 0;
        if ((to & KILN_LINK_LEAF) == 0)
            open = judge_all(w, &p->nodes[to], mask, &stands);
        if (stands != 0)
            status = link_to(w, b, context, to, stands, error);
        for (uint32_t i = open != 0 ? p->nodes[to].children : 0; i > 0; i--)
            stack[depth].mask = open, stack[depth++].to = p->nodes[to].child[i - 1];
    }
    return status == KILN_OK ? trace(w, b, context, error) : status;
}

/* Links that nobody sees anything by go. */
static void drop_unseen(struct kiln_kept_links *f)
{
    uint32_t left = 0;
    for (uint32_t i = 0; i < f->count; i++)
        if (f->seen[i] != 0) {
            f->to[left] = f->to[i];
            f->seen[left++] = f->seen[i];
        }
    f->count = left;
}

/* ---- what is kept ---- */

static void *copied(void *to, const void *from, size_t bytes) { return bytes > 0 ? memcpy(to, from, bytes) : to; }

/* Room for what has been found and the run's points, with the links in it. */
static int keep(const struct links_work *w, const struct kiln_tile_run *run, struct kiln_kept_links **links,
                struct kiln_error *error)
{
    const struct kiln_kept_links *f = &w->found;
    struct kiln_kept_links *l = NULL;
    int status = kiln_allocate(&l, 1, sizeof *l, "the links of a tile", error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->to, f->count, sizeof *l->to, "the links of a tile", error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->seen, f->count, sizeof *l->seen, "the links of a tile", error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->tinted, f->tinted_count, sizeof *l->tinted, "tinted links", error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->point, run->count, sizeof *l->point, "the points of links", error);
    if (status == KILN_OK && w->frame.smooth)
        status = kiln_allocate(&l->shading, run->count, sizeof *l->shading, "the points of links", error);
    if (status != KILN_OK) {
        kiln_links_release(&l);
        return status;
    }
    l->first = run->first.at;
    l->points = run->count;
    l->count = f->count;
    l->tinted_count = f->tinted_count;
    (void)copied(l->to, f->to, f->count * sizeof *f->to);
    (void)copied(l->seen, f->seen, f->count * sizeof *f->seen);
    (void)copied(l->tinted, f->tinted, f->tinted_count * sizeof *f->tinted);
    *links = l;
    return KILN_OK;
}

/* The points as the frame has them. */
static uint64_t enter_frame(struct links_work *w, const struct kiln_tile_run *run)
{
    uint64_t valid = 0;
    for (uint32_t j = 0; j < w->frame.count; j++) {
        const uint32_t place = w->frame.place[j];
        const struct kiln_patch *patch = &w->job->p->points[run->first.at + place];
        w->patch[place] = patch;
        w->at[place] = dvec3_of(patch->place);
        w->receiver[place] = (struct patch_receiver){
            dvec3_of(patch->normal), dvec3_of(frame_shading(&w->frame, j, patch->normal)), w->frame.smooth};
        valid |= 1ull << place;
    }
    return valid;
}

/* The points as they are kept. */
static void enter_kept(struct links_work *w, const struct kiln_kept_links *l)
{
    for (uint32_t i = 0; i < l->points; i++) {
        const struct kiln_patch *patch = &w->job->p->points[l->first + i];
        w->patch[i] = patch;
        w->at[i] = dvec3_of(patch->place);
        w->receiver[i].n = w->receiver[i].s = dvec3_of(patch->normal);
        w->receiver[i].smooth = l->shading != NULL;
        if (l->shading != NULL)
            w->receiver[i].s = dvec3((double)l->shading[i][0], (double)l->shading[i][1], (double)l->shading[i][2]);
    }
}

/* What the point's rays have met, and its normal. */
static void keep_points(const struct links_work *w, const struct kiln_point_result *gathered, struct kiln_kept_links *l)
{
    for (uint32_t j = 0; j < w->frame.count; j++) {
        const uint32_t i = w->frame.place[j];
        const struct kiln_point_result *g = &gathered[i];
        l->point[i] = (struct kiln_linked_point){.escaped = g->escaped,
                                                 .blocked = g->blocked,
                                                 .glass = {g->glass[0], g->glass[1], g->glass[2]},
                                                 .present = g->present,
                                                 .count = g->count};
        if (l->shading != NULL) {
            const struct kiln_vec3 s = vec3_of(w->receiver[i].s);
            l->shading[i][0] = s.x, l->shading[i][1] = s.y, l->shading[i][2] = s.z;
        }
    }
}

/* ---- sums ---- */

static void add_link(struct links_work *w, uint32_t place, uint32_t to, const float through[3])
{
    const struct kiln_links_parameters *p = w->job->p;
    const float *radiosity = (to & KILN_LINK_LEAF) != 0 ? p->leaf_radiosity[to & ~KILN_LINK_LEAF] : p->radiosity[to];
    const struct patch_factors f = link_factors(w, place, to);
    w->row[place] += f.factor * ((double)through[0] + (double)through[1] + (double)through[2]) / 3.0;
    for (int c = 0; c < 3; c++) {
        const double light = (double)radiosity[c] * (double)through[c];
        w->incident[place][c] += f.factor * light;
        w->irradiance[place][c] += f.shading * light;
    }
}

static void add_links(struct links_work *w, const struct kiln_kept_links *l)
{
    static const float all[3] = {1.0f, 1.0f, 1.0f};
    memset(w->row, 0, sizeof w->row);
    memset(w->incident, 0, sizeof w->incident);
    memset(w->irradiance, 0, sizeof w->irradiance);
    for (uint32_t i = 0; i < l->count; i++)
        for (uint64_t rest = l->seen[i]; rest != 0; rest &= rest - 1)
            add_link(w, (uint32_t)__builtin_ctzll(rest), l->to[i], all);
    for (uint32_t i = 0; i < l->tinted_count; i++)
        add_link(w, l->tinted[i].place, l->tinted[i].to, l->tinted[i].through);
}

static void find_scales(const struct links_work *w, const struct kiln_point_result *gathered, struct kiln_kept_links *l)
{
    for (uint32_t i = 0; i < l->points; i++)
        if (l->point[i].count > 0)
            l->point[i].scale = (float)kiln_patches_row_scale(&gathered[i], w->row[i]);
}

static void give(const struct links_work *w, const struct kiln_kept_links *l, struct kiln_point_result *results)
{
    for (uint32_t i = 0; i < l->points; i++) {
        const struct kiln_linked_point *point = &l->point[i];
        const double scale = (double)point->scale * (double)point->count;
        struct kiln_point_result *r = &results[i];
        if (point->count == 0)
            continue;
        *r = (struct kiln_point_result){.escaped = point->escaped,
                                        .blocked = point->blocked,
                                        .glass = {point->glass[0], point->glass[1], point->glass[2]},
                                        .present = point->present,
                                        .count = point->count};
        for (int c = 0; c < 3; c++) {
            r->incident[c] = (float)(scale * w->incident[i][c]);
            r->irradiance[c] = (float)(scale * w->irradiance[i][c]);
        }
    }
}

/* ---- tile runs ---- */

/* Finds the tile run's links, and sums them up. */
static int find_run(struct links_work *w, const struct embree_backend *b, struct embree_context *context,
                    size_t tile_run, struct kiln_kept_links **links, struct kiln_error *error)
{
    const struct kiln_tile_run *runs = b->surface->tile_runs, *run = &runs[tile_run];
    const struct kiln_point_result *gathered = w->job->gathered + (run->first.at - runs[w->job->part->first].first.at);
    frame_build(&w->frame, b, tile_run, UINT64_MAX, 0);
    w->found.count = w->found.tinted_count = 0;
    int status = find_links(w, b, context, enter_frame(w, run), error);
    if (status != KILN_OK)
        return status;
    drop_unseen(&w->found);
    status = keep(w, run, links, error);
    if (status != KILN_OK)
        return status;
    keep_points(w, gathered, *links);
    enter_kept(w, *links);
    add_links(w, *links);
    find_scales(w, gathered, *links);
    return KILN_OK;
}

static void links_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                           void *results, uint64_t *rays)
{
    struct links_work *w = work;
    struct kiln_kept_links **kept = w->job->p->kept, *links = kept != NULL ? kept[tile_run] : NULL;
    struct kiln_error error;
    if (has_failed(w->job))
        return;
    w->traced = 0;
    if (links != NULL) {
        enter_kept(w, links);
        add_links(w, links);
    } else {
        const int status = find_run(w, b, context, tile_run, &links, &error);
        if (status != KILN_OK) {
            fail(w->job, status, &error);
            return;
        }
    }
    give(w, links, results);
    if (kept != NULL)
        kept[tile_run] = links;
    else
        kiln_links_release(&links);
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
