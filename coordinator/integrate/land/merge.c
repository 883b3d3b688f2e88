#include "coordinator/integrate/land/merge.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/integrate/energy.h"
#include "coordinator/integrate/land/merge_lists.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/exchange.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

#define SLACK 1.001f /* margin of the radius for points sent to other ranks, against rounding */

#define DOUBT 1.5 /* standard errors of the average by which light within two radii may differ */

#define BIAS (4.0 / 3.0) /* bias, relative to the change by halving the radius */
#define LEAST_RADIUS 1.5 /* first radius tried, in texels: it includes the eight neighbours */

enum { BOXES = 64, RADII = 9, BALANCINGS = 2, FIT_STEPS = 10 };
enum { WORD = 64 }; /* bits of a word of a mask */

/* Flux landed at a point, W. */
struct flux {
    float irradiance[3], incident[3];
    float square;
    uint32_t count;
};
_Static_assert(sizeof(struct flux) == 32, "a record has no gaps");

/* Weights of a point, by the radius and half of it: s, and c = s_p times the sum of a_q s_q. */
struct weights {
    float s, c, s_half, c_half;
};
_Static_assert(sizeof(struct weights) == 16, "a record has no gaps");

struct box {
    struct kiln_vec3 low, high;
};
_Static_assert(sizeof(struct box) == 24, "a record has no gaps");

/* Points to merge: this rank's, from `own_first` on, and nearby points of other ranks, in the order of global
 * numbers. */
struct kiln_merge {
    MPI_Comm communicator;
    int rank, ranks;
    uint32_t threads;
    float radius;
    size_t own_first, own_count, count;
    const struct kiln_merge_place *own; /* places of this rank's points; borrowed */
    struct kiln_merge_place *places;    /* of all, with `radius` */
    struct flux *fluxes;
    struct weights *weights, *next; /* next: of own points */
    /* From how many points after another the light that lands may come: 1: a point that landings are near, or that has
     * some; 2: not so, but near a point that is; and so on. 0: farther, and of no use. */
    uint8_t *reached;
    float *widest;                 /* of all, while places have a fitted radius: as before the fit; else NULL */
    struct kiln_merge_grid *grid;  /* of `places`, as wide as they were before a fit */
    struct kiln_exchange exchange; /* of records of points; own ones stay where they are */
    uint32_t *sent;                /* own points that each rank gets, one rank after the other */
    size_t sent_count;
    struct flux *outgoing; /* or weights */
};

void kiln_merge_rest(struct kiln_merge *m)
{
    kiln_free(&m->fluxes);
    kiln_free(&m->weights);
    kiln_free(&m->next);
    kiln_free(&m->reached);
    kiln_free(&m->outgoing);
}

static void forget_others(struct kiln_merge *m)
{
    kiln_merge_rest(m);
    kiln_free(&m->places);
    kiln_free(&m->widest);
    kiln_merge_grid_destroy(&m->grid);
    kiln_free(&m->sent);
    m->sent_count = 0;
}

void kiln_merge_destroy(struct kiln_merge **merge)
{
    struct kiln_merge *m = *merge;
    if (m == NULL)
        return;
    forget_others(m);
    kiln_exchange_release(&m->exchange);
    kiln_free(merge);
}

/* ---- places ---- */

static void find_place(const struct kiln_merge_params *p, const struct kiln_point_cursor *at,
                       struct kiln_merge_place *place)
{
    struct kiln_footprint footprint;
    struct kiln_vec3 shading;
    const uint64_t texel = (uint64_t)at->y * p->surface->lightmaps[at->map].width + at->x;
    *place = (struct kiln_merge_place){.key = (uint64_t)at->map << 32 | texel,
                                       .lit = p->lit[at->point.at],
                                       .widest = p->widest == NULL ? INFINITY : p->widest[at->map]};
    if (!(place->lit > 0.0f))
        return;
    kiln_footprint_prepare(&footprint, p->world->scene, p->world->geometry, p->surface, at);
    kiln_footprint_normals(&footprint, &place->normal, &shading);
    place->position = kiln_footprint_extent(&footprint).centre;
}

int kiln_merge_find_places(const struct kiln_merge_params *p, struct kiln_merge_place **found, struct kiln_error *error)
{
    const struct kiln_surface *s = p->surface;
    struct kiln_merge_place *places = NULL;
    const int status = kiln_allocate(&places, s->count, sizeof *places, "the points that are merged", error);
    *found = places;
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)p->threads)
    for (size_t f = 0; f < s->tile_run_count; f++) {
        struct kiln_point_cursor at = kiln_point_first(s, f);
        for (uint32_t k = 0; k < s->tile_runs[f].count; k++, kiln_point_next(s, &at))
            find_place(p, &at, &places[at.point.at]);
    }
    return KILN_OK;
}

/* ---- points of other ranks ---- */

static struct kiln_vec3 least(struct kiln_vec3 a, struct kiln_vec3 b)
{
    return vec3(fminf(a.x, b.x), fminf(a.y, b.y), fminf(a.z, b.z));
}
static struct kiln_vec3 most(struct kiln_vec3 a, struct kiln_vec3 b)
{
    return vec3(fmaxf(a.x, b.x), fmaxf(a.y, b.y), fmaxf(a.z, b.z));
}

static const struct box nowhere = {{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}};

/* Computes BOXES bounding boxes of consecutive points that take part; some may be empty. */
static void find_boxes(const struct kiln_merge_place *places, size_t count, struct box boxes[BOXES])
{
    for (size_t b = 0; b < BOXES; b++) {
        boxes[b] = nowhere;
        for (size_t i = count * b / BOXES; i < count * (b + 1) / BOXES; i++)
            if (places[i].lit > 0.0f)
                boxes[b] =
                    (struct box){least(boxes[b].low, places[i].position), most(boxes[b].high, places[i].position)};
    }
}

static bool within(const struct box *box, struct kiln_vec3 low, struct kiln_vec3 high, float radius)
{
    return low.x - radius <= box->high.x && low.y - radius <= box->high.y && low.z - radius <= box->high.z &&
           high.x + radius >= box->low.x && high.y + radius >= box->low.y && high.z + radius >= box->low.z;
}

/* Moves those boxes of another rank to the front that may have points of this rank near them. Returns their number. */
static size_t choose_boxes(struct box boxes[BOXES], const struct box own[BOXES], float radius)
{
    struct box all = nowhere;
    size_t count = 0;
    for (size_t b = 0; b < BOXES; b++)
        all = (struct box){least(all.low, own[b].low), most(all.high, own[b].high)};
    for (size_t b = 0; b < BOXES; b++)
        if (boxes[b].low.x <= boxes[b].high.x && within(&boxes[b], all.low, all.high, radius))
            boxes[count++] = boxes[b];
    return count;
}

/* Lists and counts the points that are sent to each rank. `boxes`: of all ranks. */
static int list_sent(struct kiln_merge *m, struct box *boxes, struct kiln_error *error)
{
    struct box of_own[BOXES];
    size_t room = 0;
    const float radius = SLACK * m->radius;
    memcpy(of_own, boxes + (size_t)m->rank * BOXES, sizeof of_own);
    for (int r = 0; r < m->ranks; r++) {
        struct box *of = boxes + (size_t)r * BOXES;
        const size_t before = m->sent_count, chosen = r == m->rank ? 0 : choose_boxes(of, of_own, radius);
        for (size_t i = 0; i < m->own_count && chosen > 0; i++) {
            size_t b = 0;
            while (b < chosen && !within(&of[b], m->own[i].position, m->own[i].position, radius))
                b++;
            if (b == chosen || !(m->own[i].lit > 0.0f))
                continue;
            const int status = kiln_grow(&m->sent, &room, m->sent_count + 1, sizeof *m->sent,
                                         "the points that other ranks merge", error);
            if (status != KILN_OK)
                return status;
            m->sent[m->sent_count++] = (uint32_t)i;
        }
        m->exchange.sent[r] = m->sent_count - before;
        m->exchange.sent_at[r] = before;
    }
    return KILN_OK;
}

/* Collective. How many points come from each rank, and where among all they go: around the own ones. */
static int count_received(struct kiln_merge *m, int status, struct kiln_error *error)
{
    status = kiln_exchange_count(&m->exchange, status, error);
    if (status != KILN_OK)
        return status;
    m->own_first = m->exchange.got_at[m->rank];
    m->count = m->exchange.got_all + m->own_count;
    for (int r = m->rank + 1; r < m->ranks; r++)
        m->exchange.got_at[r] += m->own_count;
    return KILN_OK;
}

/* Lists what goes to other ranks. `boxes`: of all ranks. */
static int pack_places(struct kiln_merge *m, struct box *boxes, struct kiln_merge_place **outgoing,
                       struct kiln_error *error)
{
    int status;
    KILN_TRY(list_sent(m, boxes, error));
    KILN_TRY(kiln_allocate(outgoing, m->sent_count, sizeof **outgoing, "points for other ranks", error));
    for (size_t i = 0; i < m->sent_count; i++)
        (*outgoing)[i] = m->own[m->sent[i]];
end:
    return status;
}

/* Allocates what a step needs. */
static int make_room(struct kiln_merge *m, struct kiln_error *error)
{
    int status;
    kiln_merge_rest(m);
    KILN_TRY(kiln_allocate(&m->fluxes, m->count, sizeof *m->fluxes, "the light that is merged", error));
    KILN_TRY(kiln_allocate(&m->weights, m->count, sizeof *m->weights, "the weights of points", error));
    KILN_TRY(kiln_allocate(&m->next, m->own_count, sizeof *m->next, "the weights of points", error));
    KILN_TRY(kiln_allocate(&m->reached, m->count, sizeof *m->reached, "the points that light reaches", error));
    KILN_TRY(kiln_allocate(&m->outgoing, m->sent_count, sizeof *m->outgoing, "light for other ranks", error));
end:
    return status;
}

static int place_own(struct kiln_merge *m, struct kiln_error *error)
{
    const int status = kiln_allocate(&m->places, m->count, sizeof *m->places, "the points that are merged", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->own_count; i++)
        m->places[m->own_first + i] = m->own[i];
    return KILN_OK;
}

/* Collective. Gathers the places of this rank's points, and of nearby points of other ranks. */
static int gather_places(struct kiln_merge *m, struct kiln_error *error)
{
    struct kiln_merge_place *outgoing = NULL;
    struct box *boxes = NULL;
    int status = kiln_allocate(&boxes, (size_t)m->ranks * BOXES, sizeof *boxes, "the boxes of ranks", error);
    KILN_TRY(kiln_agree(m->communicator, status, error));
    find_boxes(m->own, m->own_count, boxes + (size_t)m->rank * BOXES);
    (void)MPI_Allgather(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, boxes, (int)(BOXES * sizeof *boxes), MPI_BYTE,
                        m->communicator);
    KILN_TRY(count_received(m, pack_places(m, boxes, &outgoing, error), error));
    status = place_own(m, error);
    if (status == KILN_OK)
        status = make_room(m, error);
    status = kiln_exchange_send(&m->exchange, status, sizeof *outgoing, outgoing, m->places, error);
end:
    kiln_free(&outgoing);
    kiln_free(&boxes);
    return status;
}

int kiln_merge_create(struct kiln_merge **merge, const struct kiln_merge_params *p, struct kiln_error *error)
{
    const char *what = "the points that are merged";
    struct kiln_merge *m = NULL;
    int status = kiln_allocate(&m, 1, sizeof *m, "the merging of light", error);
    *merge = m;
    KILN_TRY(kiln_agree(p->communicator, status, error));
    *m = (struct kiln_merge){
        .communicator = p->communicator, .threads = p->threads, .own_count = p->surface->count, .own = p->places};
    (void)MPI_Comm_rank(p->communicator, &m->rank);
    (void)MPI_Comm_size(p->communicator, &m->ranks);
    KILN_TRY(kiln_exchange_create(&m->exchange, p->communicator, p->limit, what, error));
end:
    if (status != KILN_OK)
        kiln_merge_destroy(merge);
    return status;
}

/* Makes places as wide as they were before a fit. */
static void widen(struct kiln_merge *m)
{
    if (m->widest == NULL)
        return;
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->count; i++)
        m->places[i].widest = m->widest[i];
    kiln_free(&m->widest);
}

int kiln_merge_set_radius(struct kiln_merge *m, double radius, struct kiln_error *error)
{
    const float now = (float)fmax(radius, 0.0);
    if (m->grid != NULL && !(now < m->radius || now > m->radius)) {
        widen(m);
        return kiln_agree(m->communicator, make_room(m, error), error);
    }
    forget_others(m);
    m->radius = now;
    int status = gather_places(m, error);
    if (status == KILN_OK && m->radius > 0.0f)
        status = kiln_merge_grid_create(&m->grid, m->places, m->count, m->radius, m->threads, error);
    return kiln_agree(m->communicator, status, error);
}

/* ---- points near a point ---- */

/* Distance within which two points are neighbours. */
static float radius_of(const struct kiln_merge *m, size_t a, size_t b, float radius)
{
    return fminf(radius, fminf(m->places[a].widest, m->places[b].widest));
}

static bool is_own(const struct kiln_merge *m, size_t at)
{
    return at >= m->own_first && at - m->own_first < m->own_count;
}

/* Memory of a thread: for its searches, and four numbers for each candidate of a group. */
struct hand {
    struct kiln_merge_finder finder;
    struct kiln_merge_listing listing;
    double *values;
    size_t value_room;
};

/* Function called for a group of points, of which other ranks' are to be left out. */
typedef void (*each_group)(const struct kiln_merge *m, const struct kiln_merge_group *group, float radius,
                           struct hand *hand, void *context);

/* A pass over the points that take part and have `reach` in reached[], or with reach 0 those where light landed. They
 * are this rank's; or all, if the pass `marks` the points near them as reached next, where they were not reached. */
struct pass {
    const struct kiln_merge *m;
    int reach;
    bool marks;
    float radius;
    struct kiln_merge_lists *lists; /* NULL: none are kept */
    each_group each;                /* or NULL */
    void *context;
};

static bool takes_part(const struct pass *p, size_t at)
{
    const struct kiln_merge *m = p->m;
    uint8_t reached;
    if (!(m->places[at].lit > 0.0f) || (!p->marks && !is_own(m, at)))
        return false;
#pragma omp atomic read
    reached = m->reached[at];
    return p->reach == 0 ? m->fluxes[at].count > 0 : reached == p->reach;
}

static void mark(const struct pass *p, size_t at)
{
    uint8_t *place = &p->m->reached[at], reached;
#pragma omp atomic read
    reached = *place;
    if (reached == 0 && is_own(p->m, at)) {
#pragma omp atomic write
        *place = (uint8_t)(p->reach + 1);
    }
}

/* Marks the points of a group, and those near them. */
static void mark_group(const struct pass *p, const struct kiln_merge_group *g)
{
    for (size_t i = 0; i < g->count; i++)
        mark(p, g->points[i]);
    for (size_t word = 0; word < g->words; word++) {
        uint64_t near = 0;
        for (size_t i = 0; i < g->count; i++)
            near |= g->near[i * g->words + word];
        for (; near != 0; near &= near - 1)
            mark(p, g->of[WORD * word + (size_t)__builtin_ctzll(near)]);
    }
}

static int do_group(const struct pass *p, const struct kiln_merge_group *group, struct hand *h,
                    struct kiln_error *error)
{
    const int status = kiln_grow(&h->values, &h->value_room, 4 * ((size_t)group->candidates + 1), sizeof *h->values,
                                 "points nearby", error);
    if (status != KILN_OK)
        return status;
    if (p->marks)
        mark_group(p, group);
    if (p->each != NULL)
        p->each(p->m, group, p->radius, h, p->context);
    return KILN_OK;
}

/* Finds the groups of a chunk, whose points are a mask, and does them. */
static int search_chunk(const struct pass *p, size_t chunk, uint64_t rest, struct hand *h, struct kiln_error *error)
{
    const struct kiln_merge *m = p->m;
    const bool lists = p->lists != NULL && kiln_merge_lists_have_room(p->lists);
    uint32_t points[KILN_MERGE_CHUNK];
    struct kiln_merge_group group;
    size_t words;
    int status = KILN_OK;
    h->listing.count = 0;
    while (rest != 0) {
        const uint32_t count = kiln_merge_group_choose(m->grid, m->places, chunk * KILN_MERGE_CHUNK, &rest, points);
        KILN_TRY(
            kiln_merge_group_find(m->grid, m->places, points, count, p->radius, &h->finder, &group, &words, error));
        if (lists)
            KILN_TRY(kiln_merge_lists_add(&h->listing, h->finder.words, words, error));
        KILN_TRY(do_group(p, &group, h, error));
    }
    if (lists)
        KILN_TRY(kiln_merge_lists_keep(p->lists, chunk, &h->listing, error));
end:
    return status;
}

static int do_chunk(const struct pass *p, size_t chunk, struct hand *h, struct kiln_error *error)
{
    const uint64_t *words = p->lists != NULL ? p->lists->of[chunk] : NULL;
    const size_t first = chunk * KILN_MERGE_CHUNK;
    struct kiln_merge_group group;
    uint64_t rest = 0;
    int status = KILN_OK;
    if (words != NULL) {
        const uint64_t *const end = words + words[0];
        for (words++; words < end && status == KILN_OK;) {
            words = kiln_merge_group_read(words, &group);
            status = do_group(p, &group, h, error);
        }
        return status;
    }
    for (size_t i = 0; i < KILN_MERGE_CHUNK && first + i < p->m->count; i++)
        rest |= (uint64_t)takes_part(p, first + i) << i;
    return search_chunk(p, chunk, rest, h, error);
}

/* Runs a pass on all threads. */
static int for_all(const struct pass *p, struct kiln_error *error)
{
    const size_t chunks = (p->m->count + KILN_MERGE_CHUNK - 1) / KILN_MERGE_CHUNK;
    int status = KILN_OK;
#pragma omp parallel num_threads((int)p->m->threads)
    {
        struct hand hand = {.values = NULL};
        struct kiln_error own_error = {0};
        int own = KILN_OK;
#pragma omp for schedule(dynamic, 1) nowait
        for (size_t chunk = 0; chunk < chunks; chunk++)
            if (own == KILN_OK)
                own = do_chunk(p, chunk, &hand, &own_error);
        kiln_merge_finder_release(&hand.finder);
        kiln_free(&hand.listing.words);
        kiln_free(&hand.values);
#pragma omp critical(kiln_merge)
        if (own != KILN_OK) {
            status = own;
            *error = own_error;
        }
    }
    return status;
}

/* Adds to `sum`, in order, the values of the candidates in a mask. */
static double add_masked(double sum, const uint64_t *mask, size_t words, const double *values)
{
    for (size_t word = 0; word < words; word++)
        for (uint64_t rest = mask[word]; rest != 0; rest &= rest - 1)
            sum += values[WORD * word + (size_t)__builtin_ctzll(rest)];
    return sum;
}

/* ---- weights ---- */

/* c of points. */
static void sum_weights(const struct kiln_merge *m, const struct kiln_merge_group *g, float radius, struct hand *hand,
                        void *context)
{
    struct weights *next = context;
    double *const all = hand->values, *const half = all + g->candidates;
    (void)radius;
    for (size_t i = 0; i < g->candidates; i++) {
        const double lit = (double)m->places[g->of[i]].lit;
        all[i] = lit * (double)m->weights[g->of[i]].s;
        half[i] = lit * (double)m->weights[g->of[i]].s_half;
    }
    for (size_t i = 0; i < g->count; i++) {
        const size_t at = g->points[i];
        if (!is_own(m, at))
            continue;
        const struct weights *own = &m->weights[at];
        const double lit = (double)m->places[at].lit, s = (double)own->s, s_half = (double)own->s_half,
                     c = add_masked(lit * s, g->near + i * g->words, g->words, all),
                     c_half = add_masked(lit * s_half, g->half + i * g->words, g->words, half);
        next[at - m->own_first] = (struct weights){own->s, (float)(s * c), own->s_half, (float)(s_half * c_half)};
    }
}

/* Collective. Own weights become `next`, and those of other ranks' points theirs. `status` is agreed on before. */
static int take_weights(struct kiln_merge *m, int status, struct kiln_error *error)
{
    struct weights *outgoing = (struct weights *)(void *)m->outgoing;
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->own_count; i++)
        m->weights[m->own_first + i] = m->next[i];
    for (size_t i = 0; i < m->sent_count; i++)
        outgoing[i] = m->next[m->sent[i]];
    return kiln_exchange_send(&m->exchange, status, sizeof *outgoing, outgoing, m->weights, error);
}

/* Collective. Tells other ranks which of their points' copies are reached. `status` is agreed on before. */
static int exchange_reached(struct kiln_merge *m, int status, struct kiln_error *error)
{
    uint8_t *outgoing = (uint8_t *)(void *)m->outgoing;
    for (size_t i = 0; i < m->sent_count; i++)
        outgoing[i] = m->reached[m->own_first + m->sent[i]];
    return kiln_exchange_send(&m->exchange, status, sizeof *outgoing, outgoing, m->reached, error);
}

/* Collective. Finds the points that landings are near. Landings are sparse: most points of a room may have none. */
static int find_reached(struct kiln_merge *m, float radius, struct kiln_error *error)
{
    memset(m->reached, 0, m->count);
    const int status = for_all(&(struct pass){.m = m, .marks = true, .radius = radius}, error);
    return exchange_reached(m, status, error);
}

/* Makes s of the next step from c. */
static void balance(struct kiln_merge *m)
{
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->own_count; i++) {
        struct weights *w = &m->next[i];
        w->s = w->c > 0.0f ? w->s / sqrtf(w->c) : 0.0f;
        w->s_half = w->c_half > 0.0f ? w->s_half / sqrtf(w->c_half) : 0.0f;
    }
}

/* Collective. Finds the weights of the points that are reached. What these receive depends on their weights, and these
 * on their neighbours', once for each balancing: so each sum is over fewer points than that before. `lists`: of points
 * reached by 1, 2, ... */
static int find_weights(struct kiln_merge *m, float radius, int balancings, struct kiln_merge_lists *lists,
                        struct kiln_error *error)
{
    struct pass pass = {.m = m, .radius = radius, .each = sum_weights, .context = m->next};
    int status = KILN_OK;
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->count; i++)
        m->weights[i] = (struct weights){1.0f, 1.0f, 1.0f, 1.0f};
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->own_count; i++)
        m->next[i] = (struct weights){1.0f, 1.0f, 1.0f, 1.0f};
    for (int reach = 1; reach <= 1 + balancings; reach++) {
        pass.reach = reach;
        pass.marks = reach <= balancings;
        pass.lists = reach <= BALANCINGS ? &lists[reach - 1] : NULL;
        status = for_all(&pass, error);
        if (pass.marks)
            KILN_TRY(exchange_reached(m, status, error));
    }
    pass.marks = false;
    for (int k = 1; k <= balancings; k++) {
        if (status == KILN_OK)
            balance(m);
        KILN_TRY(take_weights(m, status, error));
        for (int reach = 1; reach <= 1 + balancings - k && status == KILN_OK; reach++) {
            pass.reach = reach;
            pass.lists = &lists[reach - 1];
            status = for_all(&pass, error);
        }
    }
    status = take_weights(m, status, error);
end:
    return status;
}

/* ---- an iteration ---- */

static void add_flux(const struct flux *flux, double k, double k_half, struct kiln_merged *merged)
{
    for (int c = 0; c < 3; c++) {
        merged->irradiance[c] += k * (double)flux->irradiance[c];
        merged->incident[c] += k * (double)flux->incident[c];
    }
    merged->square += k * k * (double)flux->square;
    merged->half += k_half * kiln_luminance_of_floats(flux->irradiance);
    merged->variance += (k - k_half) * (k - k_half) * (double)flux->square;
}

/* K of two points. */
static double k_of(const struct weights *p, const struct weights *q)
{
    return (double)p->s * (double)q->s / (double)(p->c > q->c ? p->c : q->c);
}
static double k_half_of(const struct weights *p, const struct weights *q)
{
    return (double)p->s_half * (double)q->s_half / (double)(p->c_half > q->c_half ? p->c_half : q->c_half);
}

static bool is_in(const uint64_t *mask, size_t i) { return (mask[i / WORD] >> (i % WORD) & 1u) != 0; }

/* Adds to `merged` a point's own light. The part of it that the weights do not give away stays with it. */
static void collect_own(const struct kiln_merge *m, const struct kiln_merge_group *g, size_t i,
                        struct kiln_merged *merged)
{
    const size_t at = g->points[i];
    const struct weights *own = &m->weights[at];
    const double lit = (double)m->places[at].lit, k = k_of(own, own), k_half = k_half_of(own, own);
    const uint64_t *near = g->near + i * g->words, *half = g->half + i * g->words;
    double left = 1.0 - lit * k, left_half = 1.0 - lit * k_half;
    for (size_t word = 0; word < g->words; word++)
        for (uint64_t rest = near[word]; rest != 0; rest &= rest - 1) {
            const size_t c = WORD * word + (size_t)__builtin_ctzll(rest), other = g->of[c];
            left -= (double)m->places[other].lit * k_of(own, &m->weights[other]);
            if (is_in(half, c))
                left_half -= (double)m->places[other].lit * k_half_of(own, &m->weights[other]);
        }
    add_flux(&m->fluxes[at], k + left / lit, k_half + left_half / lit, merged);
}

/* Fills in the mask of the candidates where light landed. Returns whether there are any. */
static bool find_landed(const struct kiln_merge *m, const struct kiln_merge_group *g, uint64_t *mask)
{
    uint64_t any = 0;
    for (size_t word = 0; word < g->words; word++) {
        const size_t end = WORD * (word + 1) < g->candidates ? WORD * (word + 1) : g->candidates;
        mask[word] = 0;
        for (size_t c = WORD * word; c < end; c++)
            mask[word] |= (uint64_t)(m->fluxes[g->of[c]].count > 0) << c % WORD;
        any |= mask[word];
    }
    return any != 0;
}

/* Adds to `merged` the light that points receive. */
static void collect(const struct kiln_merge *m, const struct kiln_merge_group *g, float radius, struct hand *hand,
                    void *context)
{
    uint64_t *landed = (uint64_t *)(void *)hand->values;
    const bool any = find_landed(m, g, landed);
    (void)radius;
    for (size_t i = 0; i < g->count; i++) {
        const size_t at = g->points[i];
        if (!is_own(m, at))
            continue;
        const struct weights *own = &m->weights[at];
        struct kiln_merged *merged = (struct kiln_merged *)context + (at - m->own_first);
        if (m->fluxes[at].count > 0)
            collect_own(m, g, i, merged);
        for (size_t word = 0; any && word < g->words; word++)
            for (uint64_t rest = g->near[i * g->words + word] & landed[word]; rest != 0; rest &= rest - 1) {
                const size_t c = WORD * word + (size_t)__builtin_ctzll(rest), other = g->of[c];
                const struct weights *w = &m->weights[other];
                add_flux(&m->fluxes[other], k_of(own, w), is_in(g->half + i * g->words, c) ? k_half_of(own, w) : 0.0,
                         merged);
            }
    }
}

/* Collective. Sets the flux landed at this rank's points and, by exchange, at other ranks' points. */
static int take_fluxes(struct kiln_merge *m, const struct kiln_landing_sum *landed, struct kiln_error *error)
{
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->own_count; i++) {
        struct flux *flux = &m->fluxes[m->own_first + i];
        for (int c = 0; c < 3; c++) {
            flux->irradiance[c] = (float)landed[i].irradiance[c];
            flux->incident[c] = (float)landed[i].incident[c];
        }
        flux->square = (float)landed[i].square;
        flux->count = (uint32_t)landed[i].count;
    }
    for (size_t i = 0; i < m->sent_count; i++)
        m->outgoing[i] = m->fluxes[m->own_first + m->sent[i]];
    return kiln_exchange_send(&m->exchange, KILN_OK, sizeof *m->outgoing, m->outgoing, m->fluxes, error);
}

/* Collective. */
static int spread(struct kiln_merge *m, const struct kiln_landing_sum *landed, double radius, int balancings,
                  struct kiln_merged *merged, struct kiln_error *error)
{
    const float now = fminf((float)radius, m->radius);
    const size_t words = m->own_count * KILN_MERGE_LISTED_BYTES / sizeof(uint64_t) / BALANCINGS;
    struct kiln_merge_lists lists[BALANCINGS] = {{.of = NULL}};
    int status = KILN_OK;
    for (int k = 0; k < BALANCINGS && status == KILN_OK; k++)
        status = kiln_merge_lists_create(&lists[k], m->count, words, error);
    KILN_TRY(kiln_agree(m->communicator, status, error));
    KILN_TRY(take_fluxes(m, landed, error));
    KILN_TRY(find_reached(m, now, error));
    KILN_TRY(find_weights(m, now, balancings, lists, error));
    status = for_all(
        &(struct pass){.m = m, .reach = 1, .radius = now, .lists = &lists[0], .each = collect, .context = merged},
        error);
    KILN_TRY(kiln_agree(m->communicator, status, error));
end:
    for (int k = 0; k < BALANCINGS; k++)
        kiln_merge_lists_release(&lists[k]);
    return status;
}

int kiln_merge_spread(struct kiln_merge *m, const struct kiln_landing_sum *landed, double radius,
                      struct kiln_merged *merged, struct kiln_error *error)
{
    return spread(m, landed, radius, BALANCINGS, merged, error);
}

/* ---- a radius for each point ---- */

/* Context of the search for each point's radius. */
struct fit {
    double landings; /* that a radius is to have within it */
    double doubt;    /* light within two radii agrees if it differs by less than this many standard errors */
    float *radii;
};

/* Sums over the points within a radius, or between two: area, m2; landed luminance, W; and its squares. */
struct ring {
    double lit, light, square;
};

/* Computes the radii of the steps: step 0 is the point alone, the last one is the largest radius. */
static void find_steps(float largest, float radii[FIT_STEPS])
{
    radii[0] = 0.0f;
    for (int step = 1; step < FIT_STEPS; step++)
        radii[step] = largest * exp2f(-0.5f * (float)(FIT_STEPS - 1 - step));
}

_Static_assert(KILN_MERGE_RINGS == FIT_STEPS - 2, "a radius between two rings");

/* Sums up the neighbours of point i of a group by rings between successive radii. */
static void fill_rings(const struct kiln_merge *m, const struct kiln_merge_group *g, size_t i,
                       const float radii[FIT_STEPS], struct hand *hand, struct ring rings[FIT_STEPS])
{
    const double *const lit = hand->values, *const light = lit + g->candidates, *const square = light + g->candidates;
    const uint64_t *const landed = (const uint64_t *)(const void *)(square + g->candidates);
    const size_t at = g->points[i];
    const struct flux *flux = &m->fluxes[at];
    memset(rings, 0, FIT_STEPS * sizeof *rings);
    rings[0] =
        (struct ring){(double)m->places[at].lit, kiln_luminance_of_floats(flux->irradiance), (double)flux->square};
    const size_t near = kiln_merge_group_rings(&hand->finder, g, i, &m->places[at], radii + 1);
    for (size_t k = 0; k < near; k++) {
        const size_t c = hand->finder.which[k];
        struct ring *ring = &rings[FIT_STEPS - 1 - hand->finder.within[k]];
        ring->lit += lit[c];
        if (is_in(landed, c)) {
            ring->light += light[c];
            ring->square += square[c];
        }
    }
}

/* Whether the light within two radii agrees within its errors. With few landings the sum of squares is unreliable; so
 * within the narrow radius it is taken as at least the value expected from the wide one. */
static bool agree(const struct ring *narrow, const struct ring *wide, double doubt)
{
    const double expected = wide->square * narrow->lit / wide->lit,
                 error = sqrt(fmax(narrow->square, expected)) / narrow->lit + sqrt(wide->square) / wide->lit;
    return fabs(narrow->light / narrow->lit - wide->light / wide->lit) <= doubt * error;
}

/* Returns the widest step whose light agrees with that of all narrower steps, or a narrower one if that has enough
 * landings. */
static int choose_step(const struct ring rings[FIT_STEPS], const struct fit *fit)
{
    struct ring within[FIT_STEPS] = {rings[0]};
    for (int step = 0; step < FIT_STEPS; step++) {
        struct ring *all = &within[step];
        if (step > 0)
            *all = (struct ring){.lit = all[-1].lit + rings[step].lit,
                                 .light = all[-1].light + rings[step].light,
                                 .square = all[-1].square + rings[step].square};
        if (!(all->light > 0.0 || all->square > 0.0))
            continue; /* dark places agree */
        for (int narrow = 0; narrow < step; narrow++)
            if (!agree(&within[narrow], all, fit->doubt))
                return step - 1;
        if (all->square > 0.0 && all->light * all->light >= fit->landings * all->square)
            return step;
    }
    return FIT_STEPS - 1;
}

/* The radii of points. */
static void fit_points(const struct kiln_merge *m, const struct kiln_merge_group *g, float largest, struct hand *hand,
                       void *context)
{
    const struct fit *fit = context;
    double *const lit = hand->values, *const light = lit + g->candidates, *const square = light + g->candidates;
    struct ring rings[FIT_STEPS];
    float radii[FIT_STEPS];
    for (size_t c = 0; c < g->candidates; c++) {
        const struct flux *flux = &m->fluxes[g->of[c]];
        lit[c] = (double)m->places[g->of[c]].lit;
        light[c] = kiln_luminance_of_floats(flux->irradiance);
        square[c] = (double)flux->square;
    }
    (void)find_landed(m, g, (uint64_t *)(void *)(square + g->candidates));
    for (size_t i = 0; i < g->count; i++) {
        const size_t at = g->points[i];
        find_steps(radius_of(m, at, at, largest), radii);
        fill_rings(m, g, i, radii, hand, rings);
        fit->radii[at - m->own_first] = radii[choose_step(rings, fit)];
    }
}

/* Collective. Makes all points as wide as their radius is. `taken`: of all, of which own ones are known where `status`
 * is KILN_OK; the merge takes them then, and keeps how wide points were. */
static int take_radii(struct kiln_merge *m, int status, float **taken, struct kiln_error *error)
{
    float *outgoing = (float *)(void *)m->outgoing, *radii = *taken;
    for (size_t i = 0; i < m->sent_count; i++)
        outgoing[i] = radii[m->own_first + m->sent[i]];
    status = kiln_exchange_send(&m->exchange, status, sizeof *outgoing, outgoing, radii, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->count; i++) {
        const float before = m->places[i].widest;
        m->places[i].widest = radii[i];
        radii[i] = before;
    }
    m->widest = radii;
    *taken = NULL;
    return KILN_OK;
}

int kiln_merge_fit(struct kiln_merge *m, const struct kiln_landing_sum *landed, double landings, double averaged,
                   struct kiln_error *error)
{
    struct fit fit = {.landings = landings / averaged, .doubt = DOUBT / sqrt(averaged)};
    float *radii = NULL;
    widen(m);
    int status = kiln_allocate(&radii, m->count, sizeof *radii, "the radii of points", error);
    KILN_TRY(kiln_agree(m->communicator, status, error));
    fit.radii = radii + m->own_first;
    KILN_TRY(take_fluxes(m, landed, error));
    KILN_TRY(find_reached(m, m->radius, error));
    /* light that is nowhere near differs at no radius */
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = m->own_first; i < m->own_first + m->own_count; i++)
        radii[i] = radius_of(m, i, i, m->radius);
    status =
        for_all(&(struct pass){.m = m, .reach = 1, .radius = m->radius, .each = fit_points, .context = &fit}, error);
    KILN_TRY(kiln_agree(m->communicator, take_radii(m, status, &radii, error), error));
end:
    kiln_free(&radii);
    return status;
}

/* ---- radius and error ---- */

/* Squared change of light by halving the radius, without the part due to noise. */
static double change2_of(const struct kiln_merged *merged)
{
    const double difference = kiln_luminance(merged->irradiance) - merged->half;
    return difference * difference - merged->variance;
}

double kiln_merge_error(const struct kiln_merged *merged, uint64_t iterations)
{
    return sqrt(merged->square + BIAS * BIAS * fmax(0.0, change2_of(merged))) / (double)iterations;
}

double kiln_merge_radius_of(double first, double alpha, uint64_t iteration)
{
    const int doublings = 63 - __builtin_clzll(iteration + 1);
    return first * pow(2.0, 0.5 * (alpha - 1.0) * doublings);
}

/* Collective. Estimates the squared error of all iterations with a radius, over the scene, from the first iteration. */
static int find_error(struct kiln_merge *m, const struct kiln_merge_search *search, double radius, double *square,
                      struct kiln_error *error)
{
    const double unit = kiln_exact_unit(search->scale),
                 /* with half the radius the bias is 0 if that is less than a texel, else a quarter */
        bias = 0.5 * radius < search->texel ? 1.0 : BIAS;
    struct kiln_exact_sum sum = {0};
    memset(search->merged, 0, m->own_count * sizeof *search->merged);
    int status;
    KILN_TRY(kiln_merge_set_radius(m, radius, error));
    KILN_TRY(spread(m, search->landed, radius, 0, search->merged, error)); /* edges are few */
    for (size_t i = 0; i < m->own_count; i++) {
        const struct kiln_merged *merged = &search->merged[i];
        kiln_exact_add(&sum,
                       (double)m->own[i].lit *
                           (merged->square / (double)search->iterations + bias * bias * change2_of(merged)),
                       1.0 / unit);
    }
    KILN_TRY(kiln_exact_reduce(m->communicator, &sum, 1, error));
end:
    *square = kiln_exact_value(&sum, unit);
    return status;
}

int kiln_merge_find_radius(struct kiln_merge *m, const struct kiln_merge_search *search, double *radius,
                           struct kiln_error *error)
{
    double least, square, mean = 0.0;
    int worse = 0, status = find_error(m, search, 0.0, &least, error);
    *radius = 0.0;
    for (int k = 0; k < RADII && worse < 2 && status == KILN_OK; k++) {
        const double tried = search->texel * LEAST_RADIUS * pow(2.0, 0.5 * k);
        status = find_error(m, search, tried, &square, error);
        worse = square < least ? 0 : worse + 1;
        if (worse == 0) {
            least = square;
            *radius = tried;
        }
    }
    for (uint64_t i = 0; i < search->iterations; i++)
        mean += kiln_merge_radius_of(1.0, search->alpha, i) / (double)search->iterations;
    *radius /= mean;
    memset(search->merged, 0, m->own_count * sizeof *search->merged);
    return status;
}
