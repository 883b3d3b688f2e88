#include "coordinator/output/map/bands/bands.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/exchange.h"
#include "coordinator/output/exr_strips.h"
#include "coordinator/output/image.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

enum { TAG_UP = 60, TAG_DOWN = 61 };

static int mpi_failed(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "MPI failed while all ranks worked on a lightmap");
}

int kiln_bands_create(struct kiln_bands **bands, MPI_Comm communicator, struct kiln_error *error)
{
    int rank = 0, ranks = 1;
    int status = kiln_agree(communicator, kiln_allocate(bands, 1, sizeof **bands, "bands", error), error);
    if (status != KILN_OK) {
        kiln_free(bands);
        return status;
    }
    (*bands)->comm = communicator;
    (*bands)->upward = MPI_COMM_NULL;
    if (MPI_Comm_rank(communicator, &rank) != MPI_SUCCESS || MPI_Comm_size(communicator, &ranks) != MPI_SUCCESS ||
        MPI_Comm_split(communicator, 0, ranks - 1 - rank, &(*bands)->upward) != MPI_SUCCESS) {
        kiln_bands_destroy(bands);
        return mpi_failed(error);
    }
    (*bands)->rank = (uint32_t)rank;
    (*bands)->ranks = (uint32_t)ranks;
    return KILN_OK;
}

void kiln_bands_destroy(struct kiln_bands **bands)
{
    if (*bands == NULL)
        return;
    if ((*bands)->upward != MPI_COMM_NULL)
        (void)MPI_Comm_free(&(*bands)->upward);
    kiln_free(bands);
}

static uint64_t strips_of(uint32_t height) { return ((uint64_t)height + KILN_EXR_ROWS - 1) / KILN_EXR_ROWS; }

static uint32_t band_begin(uint32_t height, uint64_t rank, uint32_t ranks)
{
    const uint64_t row = strips_of(height) * rank / ranks * KILN_EXR_ROWS;
    return row < height ? (uint32_t)row : height;
}

void kiln_bands_rows(uint32_t height, uint32_t rank, uint32_t ranks, uint32_t *first, uint32_t *end)
{
    *first = band_begin(height, rank, ranks);
    *end = band_begin(height, rank + 1ull, ranks);
}

uint32_t kiln_bands_rank(uint32_t height, uint32_t ranks, uint32_t row)
{
    return (uint32_t)(((row / KILN_EXR_ROWS + 1ull) * ranks - 1) / strips_of(height));
}

int kiln_map_create_band(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                         const struct kiln_bands *bands, struct kiln_error *error)
{
    uint32_t first = 0, end = 0;
    kiln_bands_rows(height, bands->rank, bands->ranks, &first, &end);
    return kiln_map_create_rows(map, width, height, planes, bands, first, end, error);
}

int kiln_bands_agree(const struct kiln_map *map, int status, struct kiln_error *error)
{
    return map->bands == NULL ? status : kiln_agree(map->bands->comm, status, error);
}

/* ---- sums ---- */

static void add_rows(const double *rows, size_t row_count, size_t count, double *sums)
{
    memset(sums, 0, count * sizeof *sums);
    for (size_t y = 0; y < row_count; y++)
        for (size_t k = 0; k < count; k++)
            sums[k] += rows[y * count + k];
}

/* Computes each rank's number of values, and the offsets of these. */
static void list_rows(const struct kiln_map *map, size_t count, int *counts, int *starts)
{
    for (uint32_t r = 0; r < map->bands->ranks; r++) {
        uint32_t first = 0, end = 0;
        kiln_bands_rows(map->height, r, map->bands->ranks, &first, &end);
        counts[r] = (int)((end - first) * count);
        starts[r] = (int)(first * count);
    }
}

int kiln_bands_sum(const struct kiln_map *map, const double *rows, size_t count, double *sums, struct kiln_error *error)
{
    double *all = NULL;
    int *counts = NULL;
    if (map->bands == NULL) {
        add_rows(rows, map->height, count, sums);
        return KILN_OK;
    }
    const size_t ranks = map->bands->ranks;
    int status = kiln_allocate(&counts, 2 * ranks, sizeof *counts, "sums over a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate(&all, map->height * count, sizeof *all, "sums over a lightmap", error);
    if ((status = kiln_bands_agree(map, status, error)) == KILN_OK) {
        list_rows(map, count, counts, counts + ranks);
        if (MPI_Allgatherv(rows, (int)(kiln_map_rows(map) * count), MPI_DOUBLE, all, counts, counts + ranks, MPI_DOUBLE,
                           map->bands->comm) != MPI_SUCCESS)
            status = mpi_failed(error);
        else
            add_rows(all, map->height, count, sums);
    }
    kiln_free(&all);
    kiln_free(&counts);
    return status;
}

/* Sums up the luminance and the number of the surface texels in a row. */
static void add_row_light(const struct kiln_map *map, uint32_t y, double sums[2])
{
    for (size_t i = (size_t)y * map->width; i < (y + (size_t)1) * map->width; i++) {
        float rgb[3];
        if (map->state[i] == KILN_TEXEL_MARGIN)
            continue;
        for (int c = 0; c < 3; c++)
            rgb[c] = map->planes[KILN_MAP_DIRECT + c][i] + map->planes[KILN_MAP_INDIRECT + c][i];
        sums[0] += (double)kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
        sums[1] += 1.0;
    }
}

int kiln_map_mean_luminance(const struct kiln_map *map, double *mean, struct kiln_error *error)
{
    double(*rows)[2] = NULL, sums[2] = {0};
    int status = kiln_bands_agree(
        map, kiln_allocate(&rows, kiln_map_rows(map), sizeof *rows, "sums over a lightmap", error), error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (uint32_t y = map->first_row; y < map->end_row; y++)
        add_row_light(map, y, rows[y - map->first_row]);
    status = kiln_bands_sum(map, rows[0], 2, sums, error);
    *mean = sums[1] > 0.0 ? sums[0] / sums[1] : 0.0;
    kiln_free(&rows);
    return status;
}

int kiln_bands_count(const struct kiln_map *map, uint64_t *counts, size_t count, struct kiln_error *error)
{
    if (map->bands != NULL &&
        MPI_Allreduce(MPI_IN_PLACE, counts, (int)count, MPI_UINT64_T, MPI_SUM, map->bands->comm) != MPI_SUCCESS)
        return mpi_failed(error);
    return KILN_OK;
}

int kiln_bands_most(const struct kiln_map *map, double *numbers, size_t count, struct kiln_error *error)
{
    if (map->bands != NULL &&
        MPI_Allreduce(MPI_IN_PLACE, numbers, (int)count, MPI_DOUBLE, MPI_MAX, map->bands->comm) != MPI_SUCCESS)
        return mpi_failed(error);
    return KILN_OK;
}

/* ---- exchange of rows with the bands above and below ---- */

/* The rank that has a row; MPI_PROC_NULL beyond the map, or for a rank without rows. */
static int neighbour(const struct kiln_map *map, int64_t row)
{
    if (row < 0 || row >= map->height || kiln_map_rows(map) == 0)
        return MPI_PROC_NULL;
    return (int)kiln_bands_rank(map->height, map->bands->ranks, (uint32_t)row);
}

static uint32_t least(uint32_t a, uint32_t b) { return a < b ? a : b; }

int kiln_bands_halo_of(const struct kiln_map *map, void *array, size_t size, uint32_t rows, struct kiln_error *error)
{
    if (map->bands == NULL)
        return KILN_OK;
    const size_t row = map->width * size;
    unsigned char *bytes = array, *first = bytes + map->first_row * row, *end = bytes + map->end_row * row;
    const uint32_t own = least(rows, kiln_map_rows(map)), below = least(rows, map->height - map->end_row),
                   above = least(rows, map->first_row);
    const int up = neighbour(map, (int64_t)map->first_row - 1), down = neighbour(map, map->end_row);
    if (row * rows > INT_MAX)
        return kiln_fail(error, KILN_SYSTEM, "a lightmap of %u columns has rows too long for a message", map->width);
    if (MPI_Sendrecv(first, (int)(own * row), MPI_BYTE, up, TAG_UP, end, (int)(below * row), MPI_BYTE, down, TAG_UP,
                     map->bands->comm, MPI_STATUS_IGNORE) != MPI_SUCCESS ||
        MPI_Sendrecv(end - own * row, (int)(own * row), MPI_BYTE, down, TAG_DOWN, first - above * row,
                     (int)(above * row), MPI_BYTE, up, TAG_DOWN, map->bands->comm, MPI_STATUS_IGNORE) != MPI_SUCCESS)
        return mpi_failed(error);
    return KILN_OK;
}

int kiln_bands_halo(struct kiln_map *map, uint32_t arrays, uint32_t rows, struct kiln_error *error)
{
    int status = KILN_OK;
    if ((arrays & KILN_BANDS_STATE) != 0)
        KILN_TRY(kiln_bands_halo_of(map, map->state, sizeof *map->state, rows, error));
    if ((arrays & KILN_BANDS_CHART) != 0)
        KILN_TRY(kiln_bands_halo_of(map, map->chart, sizeof *map->chart, rows, error));
    for (uint32_t p = 0; (arrays & KILN_BANDS_PLANES) != 0 && p < map->has->count; p++)
        KILN_TRY(kiln_bands_halo_of(map, map->planes[p], sizeof *map->planes[p], rows, error));
end:
    return status;
}

int kiln_bands_around(const struct kiln_map *map, uint32_t *last, uint32_t *first, struct kiln_error *error)
{
    uint32_t *from = NULL;
    const int width = (int)map->width;
    if (map->bands == NULL) {
        memset(last, 0xff, map->width * sizeof *last);
        memset(first, 0xff, map->width * sizeof *first);
        return KILN_OK;
    }
    int status =
        kiln_bands_agree(map, kiln_allocate(&from, map->width, sizeof *from, "the rows around a band", error), error);
    for (uint32_t x = 0; status == KILN_OK && x < map->width; x++)
        from[x] = last[x] + 1; /* 0: none */
    memset(last, 0, map->width * sizeof *last);
    if (status == KILN_OK && MPI_Exscan(from, last, width, MPI_UINT32_T, MPI_MAX, map->bands->comm) != MPI_SUCCESS)
        status = mpi_failed(error);
    for (uint32_t x = 0; status == KILN_OK && x < map->width; x++) {
        from[x] = first[x];
        last[x] -= 1;
    }
    memset(first, 0xff, map->width * sizeof *first);
    if (status == KILN_OK && MPI_Exscan(from, first, width, MPI_UINT32_T, MPI_MIN, map->bands->upward) != MPI_SUCCESS)
        status = mpi_failed(error);
    kiln_free(&from);
    return status;
}

/* ---- single texels ---- */

/* Texels that are wanted from other ranks, in ascending order, so by rank. */
struct wanted {
    uint32_t *texels;
    size_t count, capacity;
};

static int compare_texels(const void *a, const void *b)
{
    const uint32_t p = *(const uint32_t *)a, q = *(const uint32_t *)b;
    return (p > q) - (p < q);
}

/* Lists the texels of other bands that `nearest` refers to in this band. */
static int list_wanted(const struct kiln_map *map, const uint32_t *nearest, struct wanted *w, struct kiln_error *error)
{
    const size_t first = kiln_map_first(map), end = kiln_map_end(map);
    int status = KILN_OK;
    for (size_t i = first; i < end && status == KILN_OK; i++) {
        const uint32_t from = nearest[i];
        if (from == KILN_NONE || (from >= first && from < end) || (w->count > 0 && w->texels[w->count - 1] == from) ||
            (i >= first + map->width && nearest[i - map->width] == from))
            continue; /* own, or listed already */
        status = kiln_grow(&w->texels, &w->capacity, w->count + 1, sizeof *w->texels, "texels of other bands", error);
        if (status == KILN_OK)
            w->texels[w->count++] = from;
    }
    if (w->count > 1)
        qsort(w->texels, w->count, sizeof *w->texels, compare_texels);
    size_t kept = 0;
    for (size_t i = 0; i < w->count; i++)
        if (i == 0 || w->texels[i] != w->texels[i - 1])
            w->texels[kept++] = w->texels[i];
    w->count = kept;
    return status;
}

static void pack_texel(const struct kiln_map *map, uint32_t texel, uint32_t *values)
{
    values[0] = map->chart[texel];
    for (uint32_t p = 0; p < map->has->count; p++)
        memcpy(&values[1 + p], &map->planes[p][texel], sizeof *values);
}

static void take_texel(struct kiln_map *map, uint32_t texel, const uint32_t *values)
{
    map->chart[texel] = values[0];
    for (uint32_t p = 0; p < map->has->count; p++)
        memcpy(&map->planes[p][texel], &values[1 + p], sizeof *values);
}

/* Collective. Asks the ranks that have them for the texels, and takes their answers. */
static int ask(struct kiln_exchange *e, struct kiln_map *map, const struct wanted *w, struct kiln_error *error)
{
    const size_t numbers = 1 + map->has->count;
    uint32_t *asked = NULL, *answers = NULL, *values = NULL; /* chart and planes: as bits */
    for (size_t i = 0; i < w->count; i++)
        e->sent[kiln_bands_rank(map->height, map->bands->ranks, w->texels[i] / map->width)]++;
    kiln_exchange_lay_out(e);
    int status;
    KILN_TRY(kiln_exchange_all(e, KILN_OK, sizeof *asked, w->texels, &asked, error));
    status = kiln_allocate(&answers, e->got_all * numbers, sizeof *answers, e->what, error);
    for (size_t i = 0; i < e->got_all && status == KILN_OK; i++)
        pack_texel(map, asked[i], answers + i * numbers);
    if (status == KILN_OK)
        status = kiln_allocate(&values, w->count * numbers, sizeof *values, e->what, error);
    kiln_exchange_turn(e);
    KILN_TRY(kiln_exchange_send(e, status, numbers * sizeof *values, answers, values, error));
    for (size_t i = 0; i < w->count; i++)
        take_texel(map, w->texels[i], values + i * numbers);
end:
    kiln_free(&asked);
    kiln_free(&answers);
    kiln_free(&values);
    return status;
}

int kiln_bands_fetch(struct kiln_map *map, const uint32_t *nearest, struct kiln_error *error)
{
    struct wanted wanted = {0};
    struct kiln_exchange e = {0};
    if (map->bands == NULL)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_bands_agree(map, list_wanted(map, nearest, &wanted, error), error));
    KILN_TRY(kiln_exchange_create(&e, map->bands->comm, 0, "texels of other bands", error));
    KILN_TRY(ask(&e, map, &wanted, error));
end:
    kiln_exchange_release(&e);
    kiln_free(&wanted.texels);
    return status;
}
