#include "coordinator/field/rank_data.h"

#include <string.h>

#include "coordinator/mpi/redistribute.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

/* Which memory an array lies in. */
enum place { OF_SURFACE, OF_RESULTS, OF_WORK, PLACES };

/* How many elements an array has. */
enum length { ONE_A_UNIT, ONE_MORE, ONE_IN_ALL };

struct array {
    size_t offset; /* of its pointer in struct kiln_rank_data */
    size_t size;
    enum kiln_domain unit;
    enum length length;
    enum place place;
};

#define AT(member) offsetof(struct kiln_rank_data, member)
#define SIZE(member) sizeof *((struct kiln_rank_data *)NULL)->member

static const struct array arrays[] = {
    {AT(surface.tile_runs), SIZE(surface.tile_runs), KILN_DOMAIN_TILE_RUN, ONE_A_UNIT, OF_SURFACE},
    {AT(surface.piece_base), SIZE(surface.piece_base), KILN_DOMAIN_TILE_RUN, ONE_MORE, OF_SURFACE},
    {AT(surface.area_cdf_base), SIZE(surface.area_cdf_base), KILN_DOMAIN_TILE_RUN, ONE_MORE, OF_SURFACE},
    {AT(surface.piece_count), SIZE(surface.piece_count), KILN_DOMAIN_POINT, ONE_A_UNIT, OF_SURFACE},
    {AT(surface.pieces), SIZE(surface.pieces), KILN_DOMAIN_PIECE, ONE_A_UNIT, OF_SURFACE},
    {AT(surface.area_cdf), SIZE(surface.area_cdf), KILN_DOMAIN_AREA_CDF, ONE_A_UNIT, OF_SURFACE},
    {AT(surface.albedo), 3 * SIZE(surface.albedo), KILN_DOMAIN_POINT, ONE_A_UNIT, OF_SURFACE},
    {AT(surface.area), SIZE(surface.area), KILN_DOMAIN_POINT, ONE_A_UNIT, OF_SURFACE},
    {AT(surface.visible), SIZE(surface.visible), KILN_DOMAIN_POINT, ONE_A_UNIT, OF_SURFACE},
    {AT(direct), 3 * SIZE(direct), KILN_DOMAIN_POINT, ONE_A_UNIT, OF_RESULTS},
    {AT(sum), 3 * SIZE(sum), KILN_DOMAIN_POINT, ONE_A_UNIT, OF_RESULTS},
    {AT(error), SIZE(error), KILN_DOMAIN_POINT, ONE_A_UNIT, OF_RESULTS},
    {AT(next), SIZE(next), KILN_DOMAIN_POINT, ONE_A_UNIT, OF_WORK},
    {AT(cost), SIZE(cost), KILN_DOMAIN_TILE_RUN, ONE_A_UNIT, OF_WORK},
    {AT(queue), SIZE(queue), KILN_DOMAIN_TILE_RUN, ONE_IN_ALL, OF_WORK},
};
enum { ARRAYS = sizeof arrays / sizeof *arrays };

static const char *const purposes[PLACES] = {"the surface points", "irradiance", "the radiosity of a bounce"};

/* Of a share; what the ranks of a node tell each other. */
struct extent {
    uint64_t first; /* point */
    uint64_t count[KILN_DOMAINS];
};

struct kiln_node_data {
    struct kiln_node_memory *node; /* NULL: nothing is lent */
    struct kiln_surface *surface;
    int count, own;
    struct kiln_node_parts *parts[PLACES]; /* NULL: of the surface, as it was built */
    struct kiln_rank_data *share;          /* count */
    struct extent *extents;                /* count */
};

static size_t length_of(const struct array *array, const struct extent *e)
{
    return array->length == ONE_IN_ALL ? 1 : (size_t)e->count[array->unit] + (array->length == ONE_MORE ? 1 : 0);
}

static void *pointer_at(const struct kiln_rank_data *share, const struct array *array)
{
    void *pointer;
    memcpy(&pointer, (const char *)share + array->offset, sizeof pointer);
    return pointer;
}

static void set_pointer(struct kiln_rank_data *share, const struct array *array, void *pointer)
{
    memcpy((char *)share + array->offset, &pointer, sizeof pointer);
}

/* Points the share's arrays of a place into the part that begins at `base` (NULL: does not); gives the bytes that they
 * take. */
static size_t lay_out(struct kiln_rank_data *share, const struct extent *extent, enum place place, char *base)
{
    size_t at = 0;
    for (int i = 0; i < ARRAYS; i++) {
        if (arrays[i].place != place)
            continue;
        if (base != NULL)
            set_pointer(share, &arrays[i], base + at);
        at += (length_of(&arrays[i], extent) * arrays[i].size + 63) / 64 * 64;
    }
    return at;
}

/* ---- making ---- */

/* Collective on the node. Makes a part for each of the node's arrays of a place, and points all shares there. */
static int make_parts(struct kiln_node_data *s, enum place place, struct kiln_error *error)
{
    const size_t bytes = lay_out(NULL, &s->extents[s->own], place, NULL);
    const int status = kiln_node_parts_create(&s->parts[place], s->node, bytes, purposes[place], error);
    for (int i = 0; i < s->count && status == KILN_OK; i++)
        (void)lay_out(&s->share[i], &s->extents[i], place, kiln_node_part(s->parts[place], i));
    return status;
}

static void keep_to_oneself(struct kiln_node_data *s)
{
    s->extents[0] = s->extents[s->own];
    s->share[0] = s->share[s->own];
    s->node = NULL;
    s->count = 1;
    s->own = 0;
}

/* Collective on the node. The same where the node's memory has no room, but then each rank for itself. */
static int make_somewhere(struct kiln_node_data *s, enum place place, struct kiln_error *error)
{
    if (s->node != NULL && make_parts(s, place, NULL) == KILN_OK)
        return KILN_OK;
    keep_to_oneself(s);
    return make_parts(s, place, error);
}

/* Collective on the node. All its ranks' extents, and views of the right lengths. */
static void learn_extents(struct kiln_node_data *s, const struct extent *own)
{
    if (s->node == NULL)
        s->extents[0] = *own;
    else
        (void)MPI_Allgather(own, sizeof *own, MPI_BYTE, s->extents, sizeof *own, MPI_BYTE,
                            kiln_node_communicator(s->node));
    for (int i = 0; i < s->count; i++) {
        struct kiln_surface *view = &s->share[i].surface;
        *view = *s->surface;
        view->first = s->extents[i].first;
        view->count = s->extents[i].count[KILN_DOMAIN_POINT];
        view->tile_run_count = (size_t)s->extents[i].count[KILN_DOMAIN_TILE_RUN];
    }
}

/* Of a surface that was not in parts before. */
static void free_surface(struct kiln_rank_data *share)
{
    for (int i = 0; i < ARRAYS; i++)
        if (arrays[i].place == OF_SURFACE) {
            void *old = pointer_at(share, &arrays[i]);
            kiln_free(&old);
        }
}

/* The surface has its arrays where this rank's share has them. */
static void take_over_surface(struct kiln_node_data *s)
{
    *s->surface = s->share[s->own].surface;
    s->surface->own_is_borrowed = true;
}

/* Collective on the node. The surface as it was built to memory of the node, one array after the other, so that little
 * is there twice. */
static void lend_surface(struct kiln_node_data *s)
{
    struct kiln_rank_data before = {.surface = *s->surface};
    if (s->node == NULL || make_parts(s, OF_SURFACE, NULL) != KILN_OK) {
        keep_to_oneself(s);
        return;
    }
    for (int i = 0; i < ARRAYS; i++) {
        if (arrays[i].place != OF_SURFACE)
            continue;
        void *old = pointer_at(&before, &arrays[i]);
        memcpy(pointer_at(&s->share[s->own], &arrays[i]), old,
               length_of(&arrays[i], &s->extents[s->own]) * arrays[i].size);
        kiln_free(&old);
    }
    take_over_surface(s);
}

/* Collective on the node. */
static int make_results(struct kiln_node_data *s, struct kiln_error *error)
{
    const int status = make_somewhere(s, OF_RESULTS, error);
    return status == KILN_OK ? make_somewhere(s, OF_WORK, error) : status;
}

int kiln_node_data_create(struct kiln_node_data **shares, struct kiln_node_memory *node, struct kiln_surface *surface,
                          bool lend, struct kiln_error *error)
{
    const int ranks = kiln_node_ranks(node);
    struct kiln_node_data *s = NULL;
    *shares = NULL;
    int status = kiln_allocate(&s, 1, sizeof *s, "the shares of a node", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->share, (size_t)ranks, sizeof *s->share, "the shares of a node", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->extents, (size_t)ranks, sizeof *s->extents, "the shares of a node", error);
    if (status == KILN_OK && surface->tile_run_count >= UINT32_MAX)
        status = kiln_fail(error, KILN_SYSTEM, "%zu pieces of lightmap tiles are too many for one rank: use more ranks",
                           surface->tile_run_count);
    status = kiln_agree(kiln_node_communicator(node), status, error);
    if (status == KILN_OK) {
        const struct extent own = {surface->first,
                                   {surface->tile_run_count, surface->count,
                                    surface->piece_base[surface->tile_run_count],
                                    surface->area_cdf_base[surface->tile_run_count]}};
        s->surface = surface;
        s->count = 1;
        if (lend && ranks > 1) {
            s->node = node;
            s->count = ranks;
            s->own = kiln_node_rank(node);
        }
        learn_extents(s, &own);
        lend_surface(s);
        status = kiln_agree(kiln_node_communicator(node), make_results(s, error), error);
    }
    *shares = s;
    if (status != KILN_OK)
        kiln_node_data_destroy(shares);
    return status;
}

void kiln_node_data_end(struct kiln_node_data *shares) { kiln_node_parts_destroy(&shares->parts[OF_WORK]); }

void kiln_node_data_destroy(struct kiln_node_data **shares)
{
    struct kiln_node_data *s = *shares;
    if (s == NULL)
        return;
    for (int place = PLACES - 1; place >= 0; place--)
        kiln_node_parts_destroy(&s->parts[place]);
    kiln_free(&s->share);
    kiln_free(&s->extents);
    kiln_free(shares);
}

/* ---- moving ---- */

int kiln_range_bounds_create(struct kiln_range_bounds *cuts, int ranks, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int u = 0; u < KILN_DOMAINS && status == KILN_OK; u++)
        status = kiln_allocate(&cuts->of[u], (size_t)ranks + 1, sizeof *cuts->of[u], "the shares of all ranks", error);
    return status;
}

void kiln_range_bounds_destroy(struct kiln_range_bounds *cuts)
{
    for (int u = 0; u < KILN_DOMAINS; u++)
        kiln_free(&cuts->of[u]);
}

int kiln_node_data_bounds(const struct kiln_node_data *s, MPI_Comm communicator, struct kiln_range_bounds *cuts,
                          struct kiln_error *error)
{
    int ranks;
    (void)MPI_Comm_size(communicator, &ranks);
    *cuts = (struct kiln_range_bounds){{NULL}};
    const int status = kiln_agree(communicator, kiln_range_bounds_create(cuts, ranks, error), error);
    for (int u = 0; u < KILN_DOMAINS && status == KILN_OK; u++) {
        uint64_t *of = cuts->of[u];
        (void)MPI_Allgather(&s->extents[s->own].count[u], 1, MPI_UINT64_T, of + 1, 1, MPI_UINT64_T, communicator);
        for (int r = 0; r < ranks; r++)
            of[r + 1] += of[r];
    }
    return status;
}

/* Where each tile run's pieces and area shares begin follows from what its points have. */
static void find_bases(const struct kiln_surface *s)
{
    s->piece_base[0] = s->area_cdf_base[0] = 0;
    for (size_t f = 0; f < s->tile_run_count; f++) {
        uint64_t pieces = 0;
        const uint64_t own = s->tile_runs[f].first - s->first;
        for (uint64_t i = own; i < own + s->tile_runs[f].count; i++)
            pieces += kiln_piece_count(s, i);
        s->piece_base[f + 1] = s->piece_base[f] + pieces;
        s->area_cdf_base[f + 1] = s->area_cdf_base[f] + pieces - s->tile_runs[f].count;
    }
}

/* What a move needs. */
struct move {
    MPI_Comm communicator;
    const struct kiln_range_bounds *before, *after;
    uint64_t limit;
};

/* Collective. Makes the arrays of a place anew and fills them; `old` is this rank's share as it was. */
static int move_place(struct kiln_node_data *s, const struct move *m, enum place place,
                      const struct kiln_rank_data *old, struct kiln_error *error)
{
    struct kiln_node_parts *parts = s->parts[place];
    s->parts[place] = NULL;
    int status = kiln_agree(m->communicator, make_somewhere(s, place, error), error);
    for (int i = 0; i < ARRAYS && status == KILN_OK; i++)
        if (arrays[i].place == place && arrays[i].length == ONE_A_UNIT)
            kiln_redistribute(m->communicator, m->before->of[arrays[i].unit], m->after->of[arrays[i].unit],
                              arrays[i].size, m->limit, pointer_at(old, &arrays[i]),
                              pointer_at(&s->share[s->own], &arrays[i]));
    if (parts != NULL)
        kiln_node_parts_destroy(&parts);
    return status;
}

int kiln_node_data_redistribute(struct kiln_node_data *s, MPI_Comm communicator, const struct kiln_range_bounds *before,
                                const struct kiln_range_bounds *after, uint64_t limit, struct kiln_error *error)
{
    int rank;
    (void)MPI_Comm_rank(communicator, &rank);
    const struct move m = {communicator, before, after, limit};
    struct kiln_rank_data old = s->share[s->own];
    const bool built = s->parts[OF_SURFACE] == NULL;
    struct extent own = {.first = after->of[KILN_DOMAIN_POINT][rank]};
    for (int u = 0; u < KILN_DOMAINS; u++)
        own.count[u] = after->of[u][rank + 1] - after->of[u][rank];
    kiln_node_data_end(s);
    learn_extents(s, &own);
    int status = move_place(s, &m, OF_SURFACE, &old, error);
    if (status != KILN_OK)
        return status;
    find_bases(&s->share[s->own].surface);
    if (built)
        free_surface(&old);
    take_over_surface(s);
    status = move_place(s, &m, OF_RESULTS, &old, error);
    if (status == KILN_OK)
        status = kiln_agree(communicator, make_somewhere(s, OF_WORK, error), error);
    if (status == KILN_OK && s->node != NULL)
        kiln_node_wait(s->node);
    return status;
}

uint64_t kiln_node_data_bytes(const struct kiln_node_data *s)
{
    return lay_out(NULL, &s->extents[s->own], OF_SURFACE, NULL) + lay_out(NULL, &s->extents[s->own], OF_RESULTS, NULL);
}

int kiln_node_data_count(const struct kiln_node_data *shares) { return shares->count; }
int kiln_node_data_own(const struct kiln_node_data *shares) { return shares->own; }
const struct kiln_rank_data *kiln_rank_data(const struct kiln_node_data *shares, int index)
{
    return &shares->share[index];
}
