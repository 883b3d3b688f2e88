#include "coordinator/integrate/reach/sight.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/exchange.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"
#include "worker/store/store.h"

enum { RAYS_LEAST = 8, RAYS_MOST = 32, RAYS_UNIT = 512 }; /* of a point; of a unit */
enum { UNIT_POINTS = 32, UNITS_ABOUT = 1 << 16 };
enum { TOGETHER = 1 << 16 }; /* rays that are traced in one call */
/* The R2 sequence, of the plastic number. It makes directions of neighbouring points as different as possible. */
static const double sequence[2] = {0.7548776662466927, 0.5698402909980532};

/* ---- units ---- */

/* The first point of a tile. */
static uint64_t first_of_tile(const struct kiln_surface *s, const struct kiln_tile *tile)
{
    if ((tile->first & KILN_TILE_SPLIT) == 0)
        return tile->first;
    const struct kiln_split_tile_run *run = s->splits + (tile->first & ~KILN_TILE_SPLIT);
    uint64_t rest = tile->mask, first = UINT64_MAX;
    for (; rest != 0; run++) {
        const bool divided = (run->first.at & KILN_TILE_SPLIT) != 0;
        const uint64_t at = divided ? s->divided[run->first.at & ~KILN_TILE_SPLIT].part[0].at : run->first.at;
        first = at < first ? at : first;
        rest &= ~run->mask;
    }
    return first;
}

/* Finds the first point of each lightmap. Points of lightmaps follow one another; a lightmap without points begins
 * where the next one does. */
static void first_of_lightmaps(const struct kiln_surface *s, uint64_t *first)
{
    first[s->map_count] = s->point_count;
    for (uint32_t m = s->map_count; m > 0; m--) {
        const struct kiln_lightmap *map = &s->lightmaps[m - 1];
        first[m - 1] = first[m];
        for (uint64_t t = map->tile_first; t < map->tile_first + (uint64_t)map->tiles_x * map->tiles_y; t++)
            if (s->tiles[t].mask != 0) {
                const uint64_t at = first_of_tile(s, &s->tiles[t]);
                first[m - 1] = at < first[m - 1] ? at : first[m - 1];
            }
    }
}

/* Cuts each part of the surface into equal units of at most `most` points, and returns their number. `part` and `first`
 * have one entry more than there are parts and units. `first` NULL: only counts. */
static uint64_t cut(const uint64_t *part, uint64_t parts, uint64_t most, uint64_t *first)
{
    uint64_t units = 0;
    for (uint64_t p = 0; p < parts; p++) {
        const uint64_t points = part[p + 1] - part[p], pieces = (points + most - 1) / most;
        for (uint64_t i = 0; i < pieces && first != NULL; i++)
            first[units + i] = part[p] + points / pieces * i + points % pieces * i / pieces;
        units += pieces;
    }
    if (first != NULL)
        first[units] = part[parts];
    return units;
}

static int make_units(struct kiln_sight *sight, const struct kiln_surface *s, struct kiln_error *error)
{
    const uint64_t parts = s->cell_first != NULL ? s->cell_count : s->map_count, share = s->point_count / UNITS_ABOUT,
                   most = share > UNIT_POINTS ? share : UNIT_POINTS;
    uint64_t *own = NULL;
    int status;
    KILN_TRY(s->cell_first != NULL ? KILN_OK
                                   : kiln_allocate(&own, (size_t)parts + 1, sizeof *own, "the visibility grid", error));
    if (own != NULL)
        first_of_lightmaps(s, own);
    const uint64_t *part = own != NULL ? own : s->cell_first;
    sight->units = cut(part, parts, most, NULL);
    KILN_TRY(
        kiln_allocate(&sight->first, (size_t)sight->units + 1, sizeof *sight->first, "the visibility grid", error));
    (void)cut(part, parts, most, sight->first);
end:
    kiln_free(&own);
    return status;
}

/* The unit that a point is in: the last that begins at or before it. */
static uint32_t unit_of_point(const struct kiln_sight *sight, uint64_t point)
{
    uint64_t low = 0, high = sight->units;
    while (low + 1 < high) {
        const uint64_t middle = low + (high - low) / 2;
        if (sight->first[middle] <= point)
            low = middle;
        else
            high = middle;
    }
    return (uint32_t)low;
}

/* ---- rays ---- */

/* Data for visibility rays. Borrowed but for the arrays, of TOGETHER rays each. */
struct look {
    struct kiln_sight *sight;
    const struct kiln_integrate_params *params;
    struct kiln_store store;
    struct kiln_vec3 *origins, *directions;
    struct kiln_hit *hits;
    uint32_t *from, *seen; /* units; KILN_NONE: none */
    uint8_t *is_seen;      /* per unit: whether `unit`, whose pairs are being collected, sees it */
    uint32_t unit;
    size_t pair_room;
};

/* Numbers of rays: of each point of a unit, and of all points of a tile run. */
static uint32_t rays_of_unit(const struct kiln_sight *s, uint32_t unit)
{
    const uint64_t wanted = RAYS_UNIT / (s->first[unit + 1] - s->first[unit]) + 1;
    return (uint32_t)(wanted < RAYS_LEAST ? RAYS_LEAST : wanted > RAYS_MOST ? RAYS_MOST : wanted);
}

static size_t rays_of_run(const struct kiln_sight *s, const struct kiln_tile_run *run)
{
    const uint64_t end = run->first.at + run->count;
    size_t rays = 0;
    for (uint64_t at = run->first.at, next; at < end; at = next) {
        const uint32_t unit = unit_of_point(s, at);
        next = s->first[unit + 1] < end ? s->first[unit + 1] : end;
        rays += (size_t)(next - at) * rays_of_unit(s, unit);
    }
    return rays;
}

static float unit_float(uint32_t random) { return (float)(random >> 8) * 0x1p-24f; }

/* Returns a cosine-distributed direction about n: the sum of n and a direction on the sphere. */
static struct kiln_vec3 cosine_direction(struct kiln_vec3 n, double u, double v)
{
    const double z = 1.0 - 2.0 * (u - floor(u)), radius = sqrt(1.0 - z * z), turn = 2.0 * KILN_PI * (v - floor(v));
    return vec3_normalize(vec3_add(n, vec3((float)(radius * cos(turn)), (float)(radius * sin(turn)), (float)z)));
}

/* The ray number `index` of the sequence, from the point of the cursor. */
static void set_ray(const struct look *l, const struct kiln_footprint *footprint, const struct kiln_point_cursor *at,
                    uint32_t key, uint64_t index, size_t ray)
{
    const struct kiln_geometry *g = l->params->backend->params.geometry;
    uint32_t triangle;
    float b1, b2;
    kiln_footprint_sample(footprint, unit_float(key), unit_float(kiln_hash1(key)), &triangle, &b1, &b2);
    const struct kiln_vec3 front = kiln_triangle_normal(g, triangle), n = at->back ? vec3_scale(front, -1.0f) : front;
    l->origins[ray] = kiln_offset_origin(kiln_triangle_position(g, triangle, b1, b2), n, g, triangle);
    l->directions[ray] = cosine_direction(n, (double)index * sequence[0], (double)index * sequence[1]);
    if (vec3_dot(n, n) == 0.0f) /* the triangle is too small to have a normal */
        l->from[ray] = KILN_NONE;
}

/* The rays of a tile run. */
static void set_rays(const struct look *l, size_t f, size_t first)
{
    const struct kiln_surface *s = l->params->surface;
    const struct kiln_tile_run *run = &s->tile_runs[f];
    const uint32_t seed = kiln_seed_key(l->params->settings->seed);
    struct kiln_point_cursor at = kiln_point_first(s, f);
    for (uint32_t i = 0; i < run->count; i++, kiln_point_next(s, &at)) {
        struct kiln_footprint footprint;
        kiln_footprint_prepare(&footprint, l->params->backend->params.scene, l->params->backend->params.geometry, s,
                               &at);
        const uint64_t point = kiln_global_of_own(s, at.point).at;
        const uint32_t key = kiln_texel_key(seed, 0, point);
        const uint32_t unit = unit_of_point(l->sight, point), each = rays_of_unit(l->sight, unit);
        for (uint32_t k = 0; k < each; k++, first++) {
            l->from[first] = kiln_point_valid(s, at.point) ? unit : KILN_NONE;
            set_ray(l, &footprint, &at, kiln_hash2(key, k), point * each + k, first);
        }
    }
}

/* The unit that a ray has met. */
static uint32_t unit_met(const struct look *l, const struct kiln_hit *hit)
{
    const struct kiln_geometry *g = l->params->backend->params.geometry;
    if (hit->triangle == KILN_NONE)
        return KILN_NONE;
    if (hit->back && (g->records[hit->triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0)
        return KILN_NONE;
    const struct kiln_global_point point = l->store.surface->bricks != NULL
                                               ? kiln_octree_find(&l->store, hit->triangle, hit->u, hit->v, hit->back)
                                               : kiln_store_find(&l->store, hit->triangle, hit->u, hit->v, hit->back);
    return point.at == KILN_NO_POINT ? KILN_NONE : unit_of_point(l->sight, point.at);
}

/* ---- pairs ---- */

static int add_pair(struct look *l, uint32_t from, uint32_t to, struct kiln_error *error)
{
    struct kiln_sight *s = l->sight;
    const int status =
        kiln_grow(&s->pairs, &l->pair_room, s->pair_count + 1, sizeof *s->pairs, "the visibility grid", error);
    if (status == KILN_OK)
        s->pairs[s->pair_count++] = (uint64_t)from << 32 | to;
    return status;
}

/* Collects the pairs of rays in order of the units that they come from. */
static int add_pairs(struct look *l, size_t rays, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < rays && status == KILN_OK; i++) {
        if (l->from[i] == KILN_NONE || l->seen[i] == KILN_NONE)
            continue;
        if (l->from[i] != l->unit)
            memset(l->is_seen, 0, (size_t)l->sight->units);
        l->unit = l->from[i];
        if (l->is_seen[l->seen[i]] == 0)
            status = add_pair(l, l->from[i], l->seen[i], error);
        l->is_seen[l->seen[i]] = 1;
    }
    return status;
}

/* Traces the rays of the tile runs [begin, end), which begin at `at[f - begin]`. */
static int trace(struct look *l, size_t begin, size_t end, const size_t *at, size_t rays, struct kiln_error *error)
{
    const int threads = (int)l->params->threads;
#pragma omp parallel for schedule(dynamic, 16) num_threads(threads)
    for (size_t f = begin; f < end; f++)
        set_rays(l, f, at[f - begin]);
    const int status = kiln_backend_intersect(l->params->backend, l->origins, l->directions, rays, l->hits, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static) num_threads(threads)
    for (size_t i = 0; i < rays; i++)
        l->seen[i] = unit_met(l, &l->hits[i]);
    return add_pairs(l, rays, error);
}

static int look_around(struct look *l, struct kiln_error *error)
{
    const struct kiln_surface *s = l->params->surface;
    size_t *at = NULL;
    int status = kiln_allocate(&at, TOGETHER, sizeof *at, "rays of the visibility grid", error);
    for (size_t begin = 0, end; status == KILN_OK && begin < s->tile_run_count; begin = end) {
        size_t rays = 0;
        for (end = begin; end < s->tile_run_count && end - begin < TOGETHER; end++) {
            const size_t more = rays_of_run(l->sight, &s->tile_runs[end]);
            if (rays + more > TOGETHER)
                break;
            at[end - begin] = rays;
            rays += more;
        }
        status = trace(l, begin, end, at, rays, error);
    }
    kiln_free(&at);
    return status;
}

static int compare(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y ? 1 : 0;
}

static void sort_pairs(struct kiln_sight *s)
{
    size_t kept = 0;
    qsort(s->pairs, s->pair_count, sizeof *s->pairs, compare);
    for (size_t i = 0; i < s->pair_count; i++)
        if (kept == 0 || s->pairs[kept - 1] != s->pairs[i])
            s->pairs[kept++] = s->pairs[i];
    s->pair_count = kept;
}

/* ---- symmetry ---- */

/* Messages that tell other ranks which pairs they take part in, in the order of ranks. Pairs are in ascending order,
 * coded as differences to the one before: 7 bits per byte, lowest first; the high bit says that more bytes follow. */
struct mirror {
    struct kiln_exchange exchange; /* of bytes */
    uint64_t *bounds;              /* ranks + 1: first point of each rank */
    uint64_t *last;                /* per rank: the last pair sent to it */
    uint8_t *out, *in;             /* out NULL: bytes are only counted */
};

static void mirror_release(struct mirror *m)
{
    kiln_free(&m->bounds);
    kiln_free(&m->last);
    kiln_exchange_release(&m->exchange);
    kiln_free(&m->out);
    kiln_free(&m->in);
}

/* Collective. */
static int mirror_create(struct mirror *m, const struct kiln_integrate_params *p, struct kiln_error *error)
{
    const char *what = "the visibility grid";
    const size_t ranks = (size_t)p->ranks;
    int status = kiln_exchange_create(&m->exchange, p->communicator, p->settings->exchange_limit, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&m->bounds, ranks + 1, sizeof *m->bounds, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&m->last, ranks, sizeof *m->last, what, error);
    status = kiln_agree(p->communicator, status, error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Allgather(&p->surface->first.at, 1, MPI_UINT64_T, m->bounds, 1, MPI_UINT64_T, p->communicator);
    m->bounds[ranks] = p->surface->point_count;
    return KILN_OK;
}

static void put(struct mirror *m, int rank, uint64_t pair)
{
    struct kiln_exchange *e = &m->exchange;
    uint64_t rest = pair - m->last[rank];
    m->last[rank] = pair;
    do {
        if (m->out != NULL)
            m->out[e->sent_at[rank] + e->sent[rank]] = (uint8_t)(rest & 127u) | (rest > 127u ? 128u : 0u);
        e->sent[rank]++;
        rest >>= 7;
    } while (rest > 0);
}

/* Sends a pair to all other ranks with points in its first unit. */
static void tell(const struct kiln_sight *s, struct mirror *m, int own, uint64_t pair)
{
    const uint64_t begin = s->first[pair >> 32], end = s->first[(pair >> 32) + 1];
    const int ranks = m->exchange.ranks;
    int low = 0, high = ranks;
    while (low + 1 < high) { /* the last rank that begins at or before it */
        const int middle = low + (high - low) / 2;
        if (m->bounds[middle] <= begin)
            low = middle;
        else
            high = middle;
    }
    for (int r = low; r < ranks && m->bounds[r] < end; r++)
        if (r != own && m->bounds[r + 1] > begin)
            put(m, r, pair);
}

static void tell_all(const struct kiln_sight *s, struct mirror *m, int own)
{
    memset(m->last, 0, (size_t)m->exchange.ranks * sizeof *m->last);
    memset(m->exchange.sent, 0, (size_t)m->exchange.ranks * sizeof *m->exchange.sent);
    for (size_t i = 0; i < s->pair_count; i++)
        tell(s, m, own, s->pairs[i]);
}

/* Collective. Tells all pairs, and receives those of others. */
static int tell_each_other(struct look *l, struct mirror *m, struct kiln_error *error)
{
    struct kiln_sight *s = l->sight;
    tell_all(s, m, l->params->rank);
    kiln_exchange_lay_out(&m->exchange);
    const int status = kiln_allocate(&m->out, m->exchange.sent_all, sizeof *m->out, "the visibility grid", error);
    if (status == KILN_OK)
        tell_all(s, m, l->params->rank);
    s->sent += m->exchange.sent_all;
    return kiln_exchange_all(&m->exchange, status, sizeof *m->out, m->out, &m->in, error);
}

/* Adds what a rank has told. */
static int hear(struct look *l, const struct mirror *m, int rank, struct kiln_error *error)
{
    int status = KILN_OK;
    const uint8_t *at = m->in + m->exchange.got_at[rank], *end = at + m->exchange.got[rank];
    for (uint64_t pair = 0; at < end && status == KILN_OK;) {
        uint64_t more = 0;
        uint32_t shift = 0;
        do
            more |= (uint64_t)(*at & 127u) << shift;
        while ((*at++ & 128u) != 0 && (shift += 7) < 64 && at < end);
        pair += more;
        status = add_pair(l, (uint32_t)(pair >> 32), (uint32_t)pair, error);
    }
    return status;
}

/* The pairs the other way round. */
static void turn_pairs(struct kiln_sight *s)
{
    for (size_t i = 0; i < s->pair_count; i++)
        s->pairs[i] = s->pairs[i] << 32 | s->pairs[i] >> 32;
    sort_pairs(s);
}

/* Collective. Makes visibility symmetric: each unit also gets the units that see it. */
static int mirror(struct look *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const uint64_t begin = p->surface->first.at, end = begin + p->surface->count;
    struct kiln_sight *s = l->sight;
    struct mirror m = {0};
    int status = mirror_create(&m, p, error);
    turn_pairs(s);
    if (status == KILN_OK)
        status = tell_each_other(l, &m, error);
    const size_t own = s->pair_count;
    for (size_t i = 0; i < own && status == KILN_OK; i++) {
        const uint64_t seen = s->pairs[i] >> 32, by = s->pairs[i] & UINT32_MAX;
        status = add_pair(l, (uint32_t)by, (uint32_t)seen, error);
        if (s->first[seen] >= end || s->first[seen + 1] <= begin)
            s->pairs[i] = by << 32 | seen; /* reversed pairs belong to other ranks */
    }
    for (int r = 0; r < m.exchange.ranks && status == KILN_OK; r++)
        status = hear(l, &m, r, error);
    mirror_release(&m);
    return kiln_agree(p->communicator, status, error);
}

/* ---- the grid ---- */

static void look_release(struct look *l)
{
    kiln_free(&l->origins);
    kiln_free(&l->directions);
    kiln_free(&l->hits);
    kiln_free(&l->from);
    kiln_free(&l->seen);
    kiln_free(&l->is_seen);
}

static int look_create(struct look *l, struct kiln_error *error)
{
    const char *what = "rays of the visibility grid";
    kiln_store_build(&l->store, l->params->surface, l->params->backend->params.geometry);
    int status;
    KILN_TRY(kiln_allocate(&l->origins, TOGETHER, sizeof *l->origins, what, error));
    KILN_TRY(kiln_allocate(&l->directions, TOGETHER, sizeof *l->directions, what, error));
    KILN_TRY(kiln_allocate(&l->hits, TOGETHER, sizeof *l->hits, what, error));
    KILN_TRY(kiln_allocate(&l->from, TOGETHER, sizeof *l->from, what, error));
    KILN_TRY(kiln_allocate(&l->seen, TOGETHER, sizeof *l->seen, what, error));
    KILN_TRY(kiln_allocate(&l->is_seen, (size_t)l->sight->units, sizeof *l->is_seen, what, error));
end:
    return status;
}

int kiln_sight_look(struct kiln_sight *sight, const struct kiln_integrate_params *params, struct kiln_error *error)
{
    struct look l = {.sight = sight, .params = params, .unit = KILN_NONE};
    const double start = MPI_Wtime();
    kiln_free(&sight->pairs);
    sight->pair_count = 0;
    int status = look_create(&l, error);
    if (status == KILN_OK)
        status = look_around(&l, error);
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = mirror(&l, error);
    if (status == KILN_OK)
        sort_pairs(sight);
    look_release(&l);
    sight->seconds += MPI_Wtime() - start;
    return status;
}

int kiln_sight_create(struct kiln_sight **sight, const struct kiln_integrate_params *params, struct kiln_error *error)
{
    struct kiln_sight *s = NULL;
    int status = kiln_allocate(&s, 1, sizeof *s, "the visibility grid", error);
    if (status == KILN_OK)
        status = make_units(s, params->surface, error);
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_sight_look(s, params, error);
    *sight = s;
    if (status != KILN_OK)
        kiln_sight_destroy(sight);
    return status;
}

int kiln_sight_want(const struct kiln_sight *sight, const struct kiln_integrate_params *params,
                    struct kiln_radiosity_allgather *allgather, bool now, struct kiln_error *error)
{
    uint8_t *wanted = NULL;
    if (kiln_radiosity_allgather_reach(allgather) == NULL)
        return KILN_OK;
    int status = kiln_allocate(&wanted, (size_t)sight->units, sizeof *wanted, "what a node sees", error);
    status = kiln_agree(params->communicator, status, error);
    for (size_t i = 0; status == KILN_OK && !params->settings->faults.no_sight && i < sight->pair_count; i++)
        wanted[sight->pairs[i] & UINT32_MAX] = 1;
    if (status == KILN_OK)
        status = kiln_radiosity_allgather_want(allgather, wanted, now, error);
    if (status == KILN_OK)
        status = kiln_radiosity_allgather_drop(allgather, wanted, error);
    kiln_free(&wanted);
    return status;
}
