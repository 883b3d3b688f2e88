#include "coordinator/output/map/band_sight.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/map/bands.h"
#include "coordinator/output/points.h"
#include "worker/base/memory.h"

enum { TILE_ROWS = 8, REACH = 2, FARTHEST = 1 << 30 }; /* REACH: cells along an axis */

/* A cell in which a band of a lightmap has points. */
struct spot {
    uint32_t map;
    int32_t at[3];
    uint32_t rank;
};

struct spots {
    struct spot *spots;
    size_t count, capacity;
};

struct work {
    const struct kiln_bake_result *result;
    const struct kiln_assignment *assignment;
    int ranks;
    float *largest;     /* of each lightmap in bands: the side of its largest texel, m */
    size_t *first;      /* of each tile run in `own`, and the end */
    struct spots own;   /* of tile runs, one after the other */
    struct spots known; /* of all ranks, in order, none twice */
    struct kiln_band_sight *sight;
    size_t capacity; /* of its ranks */
};

static int mpi_failed(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "MPI failed while ranks told each other where bands of lightmaps lie");
}

static bool in_bands(const struct work *w, size_t tile_run)
{
    return w->assignment->owner[w->result->surface->tile_runs[tile_run].map] == KILN_IN_BANDS;
}

/* ---- own points ---- */

static float size_of(const struct work *w, size_t tile_run, uint32_t i, const struct kiln_point_detail *detail)
{
    const struct kiln_surface *s = w->result->surface;
    const uint64_t at = kiln_own_of_global(s, s->tile_runs[tile_run].first).at + i;
    const float size = detail->coverage > 0.0f ? sqrtf(s->area[at] / detail->coverage) : 0.0f;
    return isnormal(size) ? size : 0.0f;
}

/* The largest texels of own points, then of all. */
static int find_largest(struct work *w, struct kiln_error *error)
{
    const struct kiln_surface *s = w->result->surface;
    struct kiln_point_detail details[KILN_TILE_TEXELS];
    for (size_t t = 0; t < s->tile_run_count; t++) {
        if (!in_bands(w, t))
            continue;
        float *largest = &w->largest[s->tile_runs[t].map];
        const uint32_t count = kiln_tile_run_details(w->result, t, details);
        for (uint32_t i = 0; i < count; i++)
            *largest = fmaxf(*largest, size_of(w, t, i, &details[i]));
    }
    if (MPI_Allreduce(MPI_IN_PLACE, w->largest, (int)s->map_count, MPI_FLOAT, MPI_MAX, w->result->communicator) !=
        MPI_SUCCESS)
        return mpi_failed(error);
    return KILN_OK;
}

static int32_t cell_along(double position, float size)
{
    const double at = floor(position / (double)(size * (KILN_BAND_SIGHT_TEXELS / REACH)));
    return (int32_t)fmin(fmax(at, -(double)FARTHEST), (double)FARTHEST);
}

static struct spot spot_of(const struct work *w, const struct kiln_tile_run *run, const double position[3])
{
    const struct kiln_lightmap *lightmap = &w->result->surface->lightmaps[run->map];
    const double *centre = w->result->scene->header->centre;
    struct spot spot = {
        .map = run->map,
        .rank = kiln_bands_rank(lightmap->height, (uint32_t)w->ranks, run->tile / lightmap->tiles_x * TILE_ROWS)};
    for (int c = 0; c < 3; c++)
        spot.at[c] = cell_along(position[c] - centre[c], w->largest[run->map]);
    return spot;
}

static int add_spot(struct spots *spots, const struct spot *spot, size_t from, struct kiln_error *error)
{
    for (size_t i = from; i < spots->count; i++)
        if (memcmp(&spots->spots[i], spot, sizeof *spot) == 0)
            return KILN_OK;
    const int status =
        kiln_grow(&spots->spots, &spots->capacity, spots->count + 1, sizeof *spot, "where bands lie", error);
    if (status == KILN_OK)
        spots->spots[spots->count++] = *spot;
    return status;
}

/* Lists the cells of each own tile run. */
static int list_own(struct work *w, struct kiln_error *error)
{
    const struct kiln_surface *s = w->result->surface;
    struct kiln_point_detail details[KILN_TILE_TEXELS];
    int status = KILN_OK;
    for (size_t t = 0; t < s->tile_run_count && status == KILN_OK; t++) {
        w->first[t] = w->own.count;
        if (!in_bands(w, t) || !(w->largest[s->tile_runs[t].map] > 0.0f))
            continue;
        const uint32_t count = kiln_tile_run_details(w->result, t, details);
        for (uint32_t i = 0; i < count && status == KILN_OK; i++) {
            const struct spot spot = spot_of(w, &s->tile_runs[t], details[i].position);
            status = add_spot(&w->own, &spot, w->first[t], error);
        }
    }
    w->first[s->tile_run_count] = w->own.count;
    return status;
}

/* ---- the points of all ranks ---- */

static int compare_spots(const void *a, const void *b)
{
    const struct spot *p = a, *q = b;
    if (p->map != q->map)
        return p->map < q->map ? -1 : 1;
    for (int c = 0; c < 3; c++)
        if (p->at[c] != q->at[c])
            return p->at[c] < q->at[c] ? -1 : 1;
    return (p->rank > q->rank) - (p->rank < q->rank);
}

static void sort_spots(struct spots *spots)
{
    size_t kept = 0;
    if (spots->count > 1)
        qsort(spots->spots, spots->count, sizeof *spots->spots, compare_spots);
    for (size_t i = 0; i < spots->count; i++)
        if (kept == 0 || compare_spots(&spots->spots[kept - 1], &spots->spots[i]) != 0)
            spots->spots[kept++] = spots->spots[i];
    spots->count = kept;
}

static int copy_own(struct work *w, struct spots *copy, struct kiln_error *error)
{
    const int status =
        kiln_grow(&copy->spots, &copy->capacity, w->own.count, sizeof *copy->spots, "where bands lie", error);
    if (status == KILN_OK && w->own.count > 0)
        memcpy(copy->spots, w->own.spots, w->own.count * sizeof *copy->spots);
    copy->count = status == KILN_OK ? w->own.count : 0;
    sort_spots(copy);
    return status;
}

/* How many spots each rank has, and where they go. */
static int count_spots(struct work *w, size_t own, int *counts, int *starts, struct kiln_error *error)
{
    const int mine = own < INT_MAX ? (int)own : -1;
    size_t total = 0;
    bool good = true;
    if (MPI_Allgather(&mine, 1, MPI_INT, counts, 1, MPI_INT, w->result->communicator) != MPI_SUCCESS)
        return mpi_failed(error);
    for (int r = 0; r < w->ranks; r++) {
        good = good && counts[r] >= 0 && total < INT_MAX;
        starts[r] = (int)total;
        total += (size_t)(counts[r] > 0 ? counts[r] : 0);
    }
    if (!good || total > INT_MAX)
        return kiln_fail(error, KILN_SYSTEM, "bands of lightmaps lie in too many places for one message");
    return kiln_grow(&w->known.spots, &w->known.capacity, total, sizeof *w->known.spots, "where bands lie", error);
}

static int share_spots(struct work *w, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    struct spots copy = {0};
    int *counts = NULL;
    MPI_Datatype type = MPI_DATATYPE_NULL;
    int status = copy_own(w, &copy, error);
    if (status == KILN_OK)
        status = kiln_allocate(&counts, 2 * (size_t)w->ranks, sizeof *counts, "where bands lie", error);
    if (status == KILN_OK && (MPI_Type_contiguous((int)sizeof(struct spot), MPI_BYTE, &type) != MPI_SUCCESS ||
                              MPI_Type_commit(&type) != MPI_SUCCESS))
        status = mpi_failed(error);
    if ((status = kiln_agree(comm, status, error)) == KILN_OK)
        status = kiln_agree(comm, count_spots(w, copy.count, counts, counts + w->ranks, error), error);
    if (status == KILN_OK && MPI_Allgatherv(copy.spots, (int)copy.count, type, w->known.spots, counts,
                                            counts + w->ranks, type, comm) != MPI_SUCCESS)
        status = mpi_failed(error);
    for (int r = 0; status == KILN_OK && r < w->ranks; r++)
        w->known.count += (size_t)counts[r];
    sort_spots(&w->known);
    if (type != MPI_DATATYPE_NULL)
        (void)MPI_Type_free(&type);
    kiln_free(&copy.spots);
    kiln_free(&counts);
    return status;
}

/* ---- who needs what ---- */

/* The first known spot that is not before `key`. */
static size_t find_spot(const struct work *w, const struct spot *key)
{
    size_t low = 0, high = w->known.count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (compare_spots(&w->known.spots[middle], key) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static int add_rank(struct work *w, size_t tile_run, size_t *count, uint32_t rank, struct kiln_error *error)
{
    for (size_t i = w->sight->first[tile_run]; i < *count; i++)
        if (w->sight->ranks[i] == rank)
            return KILN_OK;
    const int status =
        kiln_grow(&w->sight->ranks, &w->capacity, *count + 1, sizeof *w->sight->ranks, "where bands lie", error);
    if (status == KILN_OK)
        w->sight->ranks[(*count)++] = rank;
    return status;
}

/* Adds the ranks that have points near a spot. */
static int look_around(struct work *w, size_t tile_run, const struct spot *spot, size_t *count,
                       struct kiln_error *error)
{
    int status = KILN_OK;
    for (int32_t column = 0; column < (2 * REACH + 1) * (2 * REACH + 1) && status == KILN_OK; column++) {
        const struct spot begin = {.map = spot->map,
                                   .at = {spot->at[0] - REACH + column / (2 * REACH + 1),
                                          spot->at[1] - REACH + column % (2 * REACH + 1), spot->at[2] - REACH}};
        for (size_t i = find_spot(w, &begin); i < w->known.count && status == KILN_OK; i++) {
            const struct spot *known = &w->known.spots[i];
            if (known->map != begin.map || known->at[0] != begin.at[0] || known->at[1] != begin.at[1] ||
                known->at[2] > spot->at[2] + REACH)
                break;
            if (known->rank != spot->rank)
                status = add_rank(w, tile_run, count, known->rank, error);
        }
    }
    return status;
}

static int list_ranks(struct work *w, struct kiln_error *error)
{
    const size_t tile_runs = w->result->surface->tile_run_count;
    size_t count = 0;
    int status = KILN_OK;
    for (size_t t = 0; t < tile_runs && status == KILN_OK; t++) {
        w->sight->first[t] = count;
        for (size_t i = w->first[t]; i < w->first[t + 1] && status == KILN_OK; i++)
            status = look_around(w, t, &w->own.spots[i], &count, error);
    }
    w->sight->first[tile_runs] = count;
    return status;
}

static int find_all(struct work *w, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    const size_t tile_runs = w->result->surface->tile_run_count;
    int status = kiln_allocate(&w->largest, w->result->surface->map_count, sizeof(float), "where bands lie", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->first, tile_runs + 1, sizeof *w->first, "where bands lie", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->sight->first, tile_runs + 1, sizeof *w->sight->first, "where bands lie", error);
    if ((status = kiln_agree(comm, status, error)) == KILN_OK)
        status = find_largest(w, error);
    if (status == KILN_OK)
        status = kiln_agree(comm, list_own(w, error), error);
    if (status == KILN_OK)
        status = share_spots(w, error);
    return status == KILN_OK ? kiln_agree(comm, list_ranks(w, error), error) : status;
}

int kiln_band_sight_create(struct kiln_band_sight **sight, const struct kiln_bake_result *result,
                           const struct kiln_assignment *assignment, struct kiln_error *error)
{
    struct work w = {.result = result, .assignment = assignment};
    int status = kiln_allocate(sight, 1, sizeof **sight, "where bands lie", error);
    if (status == KILN_OK && MPI_Comm_size(result->communicator, &w.ranks) != MPI_SUCCESS)
        status = mpi_failed(error);
    status = kiln_agree(result->communicator, status, error);
    w.sight = *sight;
    if (status == KILN_OK)
        status = find_all(&w, error);
    kiln_free(&w.largest);
    kiln_free(&w.first);
    kiln_free(&w.own.spots);
    kiln_free(&w.known.spots);
    if (status != KILN_OK)
        kiln_band_sight_destroy(sight);
    return status;
}

void kiln_band_sight_destroy(struct kiln_band_sight **sight)
{
    if (*sight == NULL)
        return;
    kiln_free(&(*sight)->first);
    kiln_free(&(*sight)->ranks);
    kiln_free(sight);
}
