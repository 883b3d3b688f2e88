#include "coordinator/output/map/charts/fill.h"

#include <string.h>

#include "coordinator/output/image.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/charts/nearest.h"
#include "coordinator/output/map/stage.h"
#include "worker/base/memory.h"

enum { LAYER_ALONE = 1 << 10 }; /* texels in a layer from which on several threads process it */

/* In bands, a texel beside a band becomes known to it one layer after the neighbouring band has filled it, as if it lay
 * in the band itself. */
struct layers {
    struct kiln_map *map;
    uint8_t *known; /* for each texel: 0 unknown, 1 known, 2 in the present layer */
    uint32_t *layer, *next;
    size_t layer_count, next_count;
};

static const int neighbour_x[8] = {-1, 1, 0, 0, -1, 1, -1, 1};
static const int neighbour_y[8] = {0, 0, -1, 1, -1, -1, 1, 1};

/* Index of the k-th neighbour of a texel, or KILN_NONE outside the image. */
static uint32_t neighbour(const struct kiln_map *map, uint32_t texel, int k)
{
    const int64_t x = (int64_t)(texel % map->width) + neighbour_x[k],
                  y = (int64_t)(texel / map->width) + neighbour_y[k];
    if (x < 0 || y < 0 || x >= map->width || y >= map->height)
        return KILN_NONE;
    return (uint32_t)(y * map->width + x);
}

static bool is_own(const struct kiln_map *map, uint32_t texel)
{
    return texel >= kiln_map_first(map) && texel < kiln_map_end(map);
}

/* Claims an unknown texel for the next layer. False: it is claimed already. */
static bool claim(struct layers *work, uint32_t texel)
{
    uint8_t unknown = 0;
    return __atomic_compare_exchange_n(&work->known[texel], &unknown, 2, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED);
}

/* Adds the unknown neighbours of `texel` in its chart to the next layer, each once; several threads may call it at a
 * time. The order of texels in a layer does not matter: their values depend on earlier layers only. */
static void spread(struct layers *work, uint32_t texel)
{
    for (int k = 0; k < 8; k++) {
        const uint32_t other = neighbour(work->map, texel, k);
        if (other == KILN_NONE || !is_own(work->map, other) || work->map->state[other] != KILN_TEXEL_FILLED ||
            !kiln_map_together(work->map, other, texel) || !claim(work, other))
            continue;
        size_t at;
#pragma omp atomic capture
        at = work->next_count++;
        work->next[at] = other;
    }
}

static void take_mean(struct layers *work, uint32_t texel)
{
    const uint32_t planes = work->map->has->count;
    double sum[KILN_MAP_PLANES_MAX], weights = 0.0;
    memset(sum, 0, planes * sizeof *sum);
    for (int k = 0; k < 8; k++) {
        const uint32_t other = neighbour(work->map, texel, k);
        if (other == KILN_NONE || work->known[other] != 1 || !kiln_map_together(work->map, other, texel))
            continue;
        const double weight = k < 4 ? 2.0 : 1.0;
        for (uint32_t p = 0; p < planes; p++)
            sum[p] += weight * (double)work->map->planes[p][other];
        weights += weight;
    }
    for (uint32_t p = 0; p < planes; p++)
        work->map->planes[p][texel] = (float)(sum[p] / weights);
}

/* The rows next to the band. */
static size_t rows_around(const struct kiln_map *map, uint32_t rows[2])
{
    size_t count = 0;
    if (map->bands == NULL || kiln_map_rows(map) == 0)
        return 0;
    if (map->first_row > 0)
        rows[count++] = map->first_row - 1;
    if (map->end_row < map->height)
        rows[count++] = map->end_row;
    return count;
}

/* Spreads from the known texels in the rows next to the band, except those that were known before. `before` holds the
 * old flags of these two rows and is updated. */
static void spread_around(struct layers *work, uint8_t *before)
{
    const uint32_t width = work->map->width;
    uint32_t rows[2];
    const size_t count = rows_around(work->map, rows);
    for (size_t r = 0; r < count; r++)
        for (uint32_t x = 0; x < width; x++) {
            const uint32_t texel = rows[r] * width + x;
            if (work->known[texel] == 1 && before[r * width + x] == 0)
                spread(work, texel);
            before[r * width + x] = work->known[texel] == 1;
        }
}

/* Gets known texels and values from the bands next to this one. `before`: as in spread_around. */
static int look_around(struct layers *work, uint8_t *before, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_bands_halo_of(work->map, work->known, 1, 1, error));
    KILN_TRY(kiln_bands_halo(work->map, KILN_BANDS_PLANES, 1, error));
    spread_around(work, before);
end:
    return status;
}

/* Whether any band has a texel to fill in the next layer. */
static int is_left(const struct layers *work, bool *left, struct kiln_error *error)
{
    uint64_t count = work->next_count;
    const int status = kiln_bands_count(work->map, &count, 1, error);
    *left = count > 0;
    return status;
}

static void fill_layer(struct layers *work)
{
    uint32_t *swap = work->layer;
    work->layer = work->next;
    work->layer_count = work->next_count;
    work->next = swap;
    work->next_count = 0;
    const size_t count = work->layer_count;
#pragma omp parallel if (count > LAYER_ALONE)
    {
#pragma omp for schedule(static)
        for (size_t i = 0; i < count; i++)
            take_mean(work, work->layer[i]);
#pragma omp for schedule(static)
        for (size_t i = 0; i < count; i++)
            work->known[work->layer[i]] = 1;
#pragma omp for schedule(static)
        for (size_t i = 0; i < count; i++)
            spread(work, work->layer[i]);
    }
}

/* Whether a texel has a neighbour in its chart that is known. */
static bool is_next(const struct layers *work, uint32_t texel)
{
    bool found = false;
    for (int k = 0; k < 8 && !found; k++) {
        const uint32_t other = neighbour(work->map, texel, k);
        found = other != KILN_NONE && work->known[other] == 1 && kiln_map_together(work->map, other, texel);
    }
    return found;
}

/* Marks texels with light as known, and makes the first layer of their neighbours. */
static void begin_layers(struct layers *work)
{
    const struct kiln_map *map = work->map;
    const size_t first = kiln_map_first(map), end = kiln_map_end(map);
#pragma omp parallel for schedule(static) if (end - first > KILN_IMAGE_ALONE)
    for (size_t i = first; i < end; i++)
        work->known[i] = map->state[i] == KILN_TEXEL_VALID;
#pragma omp parallel for schedule(static) if (end - first > KILN_IMAGE_ALONE)
    for (size_t i = first; i < end; i++)
        if (map->state[i] == KILN_TEXEL_FILLED && is_next(work, (uint32_t)i)) {
            size_t at;
#pragma omp atomic capture
            at = work->next_count++;
            work->next[at] = (uint32_t)i;
        }
    for (size_t i = 0; i < work->next_count; i++)
        work->known[work->next[i]] = 2;
}

static int fill_charts(struct layers *work, uint8_t *before, struct kiln_error *error)
{
    bool left = false;
    begin_layers(work);
    int status;
    KILN_TRY(look_around(work, before, error));
    KILN_TRY(is_left(work, &left, error));
    while (left) {
        fill_layer(work);
        KILN_TRY(look_around(work, before, error));
        KILN_TRY(is_left(work, &left, error));
    }
end:
    return status;
}

/* Fills charts without valid texels. */
static int fill_rest(struct layers *work, struct kiln_error *error)
{
    struct kiln_map *map = work->map;
    const size_t first = kiln_map_first(map), end = kiln_map_end(map);
    uint32_t *nearest = NULL;
    uint64_t left = 0;
#pragma omp parallel for schedule(static) reduction(+ : left) if (end - first > KILN_IMAGE_ALONE)
    for (size_t i = first; i < end; i++)
        left += map->state[i] == KILN_TEXEL_FILLED && work->known[i] == 0;
    int status = kiln_bands_count(map, &left, 1, error);
    if (status != KILN_OK || left == 0)
        return status;
    status = kiln_bands_agree(map, kiln_map_allocate(map, &nearest, sizeof *nearest, "nearest texels", error), error);
    if (status == KILN_OK)
        status = kiln_map_nearest(map, work->known, 1, nearest, error);
#pragma omp parallel for schedule(static) if (status == KILN_OK && end - first > KILN_IMAGE_ALONE)
    for (size_t i = first; i < (status == KILN_OK ? end : first); i++)
        if (map->state[i] != KILN_TEXEL_FILLED || work->known[i] != 0)
            nearest[i] = (uint32_t)i; /* stays as it is */
    if (status == KILN_OK)
        status = kiln_bands_fetch(map, nearest, error);
#pragma omp parallel for schedule(static) if (status == KILN_OK && end - first > KILN_IMAGE_ALONE)
    for (size_t i = first; i < (status == KILN_OK ? end : first); i++)
        for (uint32_t p = 0; nearest[i] != i && nearest[i] != KILN_NONE && p < map->has->count; p++)
            map->planes[p][i] = map->planes[p][nearest[i]];
    kiln_map_free(map, &nearest, sizeof *nearest);
    return status;
}

static void clear_filled(struct kiln_map *map)
{
#pragma omp parallel for schedule(static) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++)
        for (uint32_t p = 0; map->state[i] == KILN_TEXEL_FILLED && p < map->has->count; p++)
            map->planes[p][i] = 0.0f;
}

int kiln_map_fill(struct kiln_map *map, struct kiln_error *error)
{
    uint8_t *before = NULL;
    uint64_t invalid = 0;
#pragma omp parallel for schedule(static) reduction(+ : invalid) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++)
        invalid += map->state[i] == KILN_TEXEL_FILLED;
    const size_t own = invalid;
    int status = kiln_bands_count(map, &invalid, 1, error);
    if (status != KILN_OK || invalid == 0)
        return status;
    struct layers work = {.map = map};
    KILN_TRY(kiln_map_allocate(map, &work.known, 1, "known texels", error));
    KILN_TRY(kiln_allocate(&work.layer, own, sizeof(uint32_t), "texels to fill", error));
    KILN_TRY(kiln_allocate(&work.next, own, sizeof(uint32_t), "texels to fill", error));
    if (map->bands != NULL)
        KILN_TRY(kiln_allocate(&before, 2 * (size_t)map->width, 1, "texels to fill", error));
end:
    status = kiln_bands_agree(map, status, error);
    if (status == KILN_OK) {
        clear_filled(map);
        status = fill_charts(&work, before, error);
    }
    if (status == KILN_OK)
        status = fill_rest(&work, error);
    kiln_map_free(map, &work.known, 1);
    kiln_free(&work.layer);
    kiln_free(&work.next);
    kiln_free(&before);
    return status;
}

static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    const int status = kiln_bands_halo(work->map, KILN_BANDS_STATE | KILN_BANDS_CHART, KILN_BANDS_HALO, error);
    return status == KILN_OK ? kiln_map_fill(work->map, error) : status;
}

const struct kiln_map_stage kiln_map_stage_fill = {.name = "fill", .features = KILN_MAP_CHARTS, .run = run};
