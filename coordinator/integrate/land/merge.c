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
/* Radii from the next landing within which points take part in a spreading. What a point receives depends on the
 * weights of points within one radius of landings; these depend on their neighbours', once for each balancing. */
enum { REACH = 1 + BALANCINGS };

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
    uint8_t *reached;               /* how far landings are, in radii, at most: 1 to REACH; 0: farther, and of no use */
    uint8_t *set;                   /* of cells (merge_near.h) */
    bool fitted;                    /* each place has a fitted radius */
    struct kiln_merge_grid *grid;   /* of `places` */
    struct kiln_exchange exchange;  /* of records of points; own ones stay where they are */
    uint32_t *sent;                 /* own points that each rank gets, one rank after the other */
    size_t sent_count;
    struct flux *outgoing; /* or weights */
};

static void forget_others(struct kiln_merge *m)
{
    kiln_free(&m->places);
    kiln_free(&m->fluxes);
    kiln_free(&m->weights);
    kiln_free(&m->next);
    kiln_free(&m->reached);
    kiln_free(&m->set);
    m->fitted = false;
    kiln_merge_grid_destroy(&m->grid);
    kiln_free(&m->sent);
    kiln_free(&m->outgoing);
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
    KILN_TRY(kiln_allocate(&m->outgoing, m->sent_count, sizeof *m->outgoing, "light for other ranks", error));
    for (size_t i = 0; i < m->sent_count; i++)
        (*outgoing)[i] = m->own[m->sent[i]];
end:
    return status;
}

static int make_room(struct kiln_merge *m, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_allocate(&m->places, m->count, sizeof *m->places, "the points that are merged", error));
    KILN_TRY(kiln_allocate(&m->fluxes, m->count, sizeof *m->fluxes, "the light that is merged", error));
    KILN_TRY(kiln_allocate(&m->weights, m->count, sizeof *m->weights, "the weights of points", error));
    KILN_TRY(kiln_allocate(&m->next, m->own_count, sizeof *m->next, "the weights of points", error));
    KILN_TRY(kiln_allocate(&m->reached, m->count, sizeof *m->reached, "the points that light reaches", error));
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->own_count; i++)
        m->places[m->own_first + i] = m->own[i];
end:
    return status;
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

int kiln_merge_set_radius(struct kiln_merge *m, double radius, struct kiln_error *error)
{
    forget_others(m);
    m->radius = (float)fmax(radius, 0.0);
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

static bool in_half(const struct kiln_merge *m, size_t a, size_t b, float radius)
{
    return a == b || kiln_merge_are_near(&m->places[a], &m->places[b], 0.5f * radius_of(m, a, b, radius));
}

/* Searches for the neighbours of point `at`. `halves`: fills in `half`, too. */
static int search_for(const struct kiln_merge *m, size_t at, float radius, bool halves, struct kiln_merge_neighbours *n,
                      struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_merge_grid_find(m->grid, at, radius_of(m, at, at, radius), &n->near, error));
    KILN_TRY(kiln_grow(&n->half, &n->half_room, n->near.count, sizeof *n->half, "points nearby", error));
    for (size_t i = 0; halves && i < n->near.count; i++)
        n->half[i] = in_half(m, at, n->near.of[i], radius);
end:
    return status;
}

/* ---- weights ---- */

/* Function called for a point `at` of this rank, with its neighbours. */
typedef void (*each_point)(const struct kiln_merge *m, size_t at, float radius,
                           const struct kiln_merge_neighbours *near, void *context);

/* A pass over points of this rank that take part, and that landings reach from up to `reach` radii away. `lists`: NULL:
 * the function uses no halves. */
struct pass {
    const struct kiln_merge *m;
    int reach;
    float radius;
    struct kiln_merge_lists *lists;
    each_point each;
    void *context;
};

static bool is_reached(const struct kiln_merge *m, size_t at, int reach)
{
    return m->reached[at] > 0 && m->reached[at] <= reach;
}

/* Calls the function for the points of a chunk. */
static int do_chunk(const struct pass *p, size_t chunk, struct kiln_merge_neighbours *n,
                    struct kiln_merge_listing *listing, struct kiln_error *error)
{
    const struct kiln_merge *m = p->m;
    const uint32_t *entry = p->lists != NULL ? p->lists->of[chunk] : NULL;
    const bool listed = entry != NULL, lists = p->lists != NULL && !listed && kiln_merge_lists_have_room(p->lists);
    const size_t end =
        m->own_first + ((chunk + 1) * KILN_MERGE_CHUNK < m->own_count ? (chunk + 1) * KILN_MERGE_CHUNK : m->own_count);
    int status = KILN_OK;
    listing->count = 0;
    for (size_t at = m->own_first + chunk * KILN_MERGE_CHUNK; at < end; at++) {
        if (!(m->places[at].lit > 0.0f) || !is_reached(m, at, p->reach))
            continue;
        if (listed) {
            entry = kiln_merge_lists_read(entry, n, error);
            if (entry == NULL)
                return KILN_SYSTEM;
        } else {
            KILN_TRY(search_for(m, at, p->radius, p->lists != NULL, n, error));
        }
        if (lists)
            KILN_TRY(kiln_merge_lists_add(listing, n, error));
        p->each(m, at, p->radius, n, p->context);
    }
    if (lists)
        KILN_TRY(kiln_merge_lists_keep(p->lists, chunk, listing, error));
end:
    return status;
}

/* Runs a pass on all threads. */
static int for_all(const struct pass *p, struct kiln_error *error)
{
    const size_t chunks = (p->m->own_count + KILN_MERGE_CHUNK - 1) / KILN_MERGE_CHUNK;
    int status = KILN_OK;
#pragma omp parallel num_threads((int)p->m->threads)
    {
        struct kiln_merge_neighbours near = {.half = NULL};
        struct kiln_merge_listing listing = {.entries = NULL};
        struct kiln_error own_error = {0};
        int own = KILN_OK;
#pragma omp for schedule(dynamic, 1) nowait
        for (size_t chunk = 0; chunk < chunks; chunk++)
            if (own == KILN_OK)
                own = do_chunk(p, chunk, &near, &listing, &own_error);
        kiln_free(&near.near.of);
        kiln_free(&near.half);
        kiln_free(&listing.entries);
#pragma omp critical(kiln_merge)
        if (own != KILN_OK) {
            status = own;
            *error = own_error;
        }
    }
    return status;
}

/* c of a point. */
static void sum_weights(const struct kiln_merge *m, size_t at, float radius, const struct kiln_merge_neighbours *near,
                        void *context)
{
    const struct weights *own = &m->weights[at];
    struct weights *next = (struct weights *)context + (at - m->own_first);
    double all = 0.0, half = 0.0;
    (void)radius;
    for (size_t i = 0; i < near->near.count; i++) {
        const size_t other = near->near.of[i];
        const double lit = (double)m->places[other].lit;
        all += lit * (double)m->weights[other].s;
        half += near->half[i] ? lit * (double)m->weights[other].s_half : 0.0;
    }
    *next = (struct weights){own->s, (float)((double)own->s * all), own->s_half, (float)((double)own->s_half * half)};
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

/* Collective. */
static int find_weights(struct kiln_merge *m, float radius, int balancings, struct kiln_merge_lists *lists,
                        struct kiln_error *error)
{
    const struct pass pass = {m, REACH, radius, lists, sum_weights, m->next};
    int status = KILN_OK;
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->count; i++)
        m->weights[i] = (struct weights){1.0f, 1.0f, 1.0f, 1.0f};
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->own_count; i++)
        m->next[i] = (struct weights){1.0f, 1.0f, 1.0f, 1.0f};
    for (int k = 0; k <= balancings && status == KILN_OK; k++) {
        status = for_all(&pass, error);
#pragma omp parallel for num_threads((int)m->threads) schedule(static) if (k < balancings)
        for (size_t i = 0; i < (k < balancings ? m->own_count : 0); i++) {
            struct weights *w = &m->next[i];
            w->s = w->c > 0.0f ? w->s / sqrtf(w->c) : 0.0f;
            w->s_half = w->c_half > 0.0f ? w->s_half / sqrtf(w->c_half) : 0.0f;
        }
        status = take_weights(m, status, error);
    }
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

/* Adds to `merged` the light that point `at` receives. The part of its own light that the weights do not give away
 * stays with it. */
static void collect(const struct kiln_merge *m, size_t at, float radius, const struct kiln_merge_neighbours *near,
                    void *context)
{
    const struct weights *own = &m->weights[at];
    const double lit = (double)m->places[at].lit;
    struct kiln_merged *merged = (struct kiln_merged *)context + (at - m->own_first);
    double left = 1.0, left_half = 1.0;
    (void)radius;
    for (int pass = 0; pass < 2; pass++) /* the first pass finds the part that stays */
        for (size_t i = 0; i < near->near.count; i++) {
            const size_t other = near->near.of[i];
            const struct flux *flux = &m->fluxes[other];
            const struct weights *w = &m->weights[other];
            const double k = (double)own->s * (double)w->s / fmax((double)own->c, (double)w->c),
                         k_half = near->half[i] ? (double)own->s_half * (double)w->s_half /
                                                      fmax((double)own->c_half, (double)w->c_half)
                                                : 0.0;
            if (pass == 0) {
                left -= (double)m->places[other].lit * k;
                left_half -= (double)m->places[other].lit * k_half;
            } else if (flux->count > 0) {
                add_flux(flux, other == at ? k + left / lit : k, other == at ? k_half + left_half / lit : k_half,
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

/* Marks own points within a radius of points that were reached before. */
static void reach_on(struct kiln_merge *m, int step)
{
    memset(m->set, 0, kiln_merge_grid_slots(m->grid) * sizeof *m->set);
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->count; i++)
        if (step == 1 ? m->fluxes[i].count > 0 : m->reached[i] > 0)
            kiln_merge_grid_mark(m->grid, i, m->set);
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = m->own_first; i < m->own_first + m->own_count; i++)
        if (m->reached[i] == 0 && m->places[i].lit > 0.0f && kiln_merge_grid_marked(m->grid, i, m->set))
            m->reached[i] = (uint8_t)step;
}

/* Collective. Finds how many radii away from landings points are, up to `reach`. Light of iterations is sparse: most
 * points of a room may have none near them, and need no search for their neighbours. */
static int find_reached(struct kiln_merge *m, int reach, struct kiln_error *error)
{
    uint8_t *outgoing = (uint8_t *)(void *)m->outgoing;
    int status = KILN_OK;
    if (m->grid == NULL) {
        memset(m->reached, 1, m->count);
        return KILN_OK;
    }
    kiln_free(&m->set);
    status =
        kiln_allocate(&m->set, kiln_merge_grid_slots(m->grid), sizeof *m->set, "the points that light reaches", error);
    KILN_TRY(kiln_agree(m->communicator, status, error));
    memset(m->reached, 0, m->count);
    for (int step = 1; step <= reach; step++) {
        reach_on(m, step);
        for (size_t i = 0; i < m->sent_count; i++)
            outgoing[i] = m->reached[m->own_first + m->sent[i]];
        KILN_TRY(kiln_exchange_send(&m->exchange, KILN_OK, sizeof *outgoing, outgoing, m->reached, error));
    }
end:
    return status;
}

/* Collective. */
static int spread(struct kiln_merge *m, const struct kiln_landing_sum *landed, double radius, int balancings,
                  struct kiln_merged *merged, struct kiln_error *error)
{
    const float now = fminf((float)radius, m->radius);
    struct kiln_merge_lists lists;
    const struct pass pass = {m, REACH, now, &lists, collect, merged};
    int status = kiln_merge_lists_create(&lists, m->own_count, m->count, error);
    KILN_TRY(kiln_agree(m->communicator, status, error));
    KILN_TRY(take_fluxes(m, landed, error));
    KILN_TRY(find_reached(m, 1 + balancings, error));
    KILN_TRY(find_weights(m, now, balancings, &lists, error));
    KILN_TRY(kiln_agree(m->communicator, for_all(&pass, error), error));
end:
    kiln_merge_lists_release(&lists);
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

/* Sorts the neighbours into rings between successive radii. Most belong to the widest, which is tried first. */
static void fill_rings(const struct kiln_merge *m, size_t at, const float radii[FIT_STEPS],
                       const struct kiln_merge_near *near, struct ring rings[FIT_STEPS])
{
    memset(rings, 0, FIT_STEPS * sizeof *rings);
    for (size_t i = 0; i < near->count; i++) {
        const size_t other = near->of[i];
        const struct kiln_merge_place *a = &m->places[at], *b = &m->places[other];
        const struct flux *flux = &m->fluxes[other];
        int step = other == at ? 0 : FIT_STEPS - 1;
        while (step > 1 && kiln_merge_are_near(a, b, radii[step - 1]))
            step--;
        rings[step].lit += (double)b->lit;
        rings[step].light += kiln_luminance_of_floats(flux->irradiance);
        rings[step].square += (double)flux->square;
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
        for (int narrow = 0; narrow < step; narrow++)
            if (!agree(&within[narrow], all, fit->doubt))
                return step - 1;
        if (all->square > 0.0 && all->light * all->light >= fit->landings * all->square)
            return step;
    }
    return FIT_STEPS - 1;
}

/* The radius of a point. */
static void fit_point(const struct kiln_merge *m, size_t at, float largest, const struct kiln_merge_neighbours *near,
                      void *context)
{
    const struct fit *fit = context;
    struct ring rings[FIT_STEPS];
    float radii[FIT_STEPS];
    find_steps(radius_of(m, at, at, largest), radii);
    fill_rings(m, at, radii, &near->near, rings);
    fit->radii[at - m->own_first] = radii[choose_step(rings, fit)];
}

/* Collective. Makes all points as wide as their radius is. `radii`: of all, of which own ones are known where `status`
 * is KILN_OK. */
static int take_radii(struct kiln_merge *m, int status, float *radii, struct kiln_error *error)
{
    float *outgoing = (float *)(void *)m->outgoing;
    for (size_t i = 0; i < m->sent_count; i++)
        outgoing[i] = radii[m->own_first + m->sent[i]];
    status = kiln_exchange_send(&m->exchange, status, sizeof *outgoing, outgoing, radii, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = 0; i < m->count; i++)
        m->places[i].widest = radii[i];
    m->fitted = true;
    kiln_merge_grid_destroy(&m->grid);
    return m->radius > 0.0f ? kiln_merge_grid_create(&m->grid, m->places, m->count, m->radius, m->threads, error)
                            : KILN_OK;
}

int kiln_merge_fit(struct kiln_merge *m, const struct kiln_landing_sum *landed, double landings, double averaged,
                   struct kiln_error *error)
{
    struct fit fit = {.landings = landings / averaged, .doubt = DOUBT / sqrt(averaged)};
    float *radii = NULL;
    int status = m->fitted ? kiln_merge_set_radius(m, (double)m->radius, error) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_allocate(&radii, m->count, sizeof *radii, "the radii of points", error);
    KILN_TRY(kiln_agree(m->communicator, status, error));
    fit.radii = radii + m->own_first;
    KILN_TRY(take_fluxes(m, landed, error));
    KILN_TRY(find_reached(m, 1, error));
    /* light that is nowhere near differs at no radius */
#pragma omp parallel for num_threads((int)m->threads) schedule(static)
    for (size_t i = m->own_first; i < m->own_first + m->own_count; i++)
        radii[i] = radius_of(m, i, i, m->radius);
    status = for_all(&(struct pass){m, 1, m->radius, NULL, fit_point, &fit}, error);
    KILN_TRY(kiln_agree(m->communicator, take_radii(m, status, radii, error), error));
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
