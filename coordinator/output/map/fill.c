#include <string.h>

#include "coordinator/output/map/stage.h"
#include "worker/base/memory.h"

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

/* Adds the unknown neighbours of `texel` in its chart to the next layer, each once. */
static void spread(struct layers *work, uint32_t texel)
{
    for (int k = 0; k < 8; k++) {
        const uint32_t other = neighbour(work->map, texel, k);
        if (other == KILN_NONE || work->known[other] != 0 || work->map->state[other] != KILN_TEXEL_FILLED ||
            work->map->chart[other] != work->map->chart[texel])
            continue;
        work->known[other] = 2;
        work->next[work->next_count++] = other;
    }
}

static void take_mean(struct layers *work, uint32_t texel)
{
    const uint32_t planes = work->map->has->count;
    double sum[KILN_MAP_PLANES_MAX], weights = 0.0;
    memset(sum, 0, planes * sizeof *sum);
    for (int k = 0; k < 8; k++) {
        const uint32_t other = neighbour(work->map, texel, k);
        if (other == KILN_NONE || work->known[other] != 1 || work->map->chart[other] != work->map->chart[texel])
            continue;
        const double weight = k < 4 ? 2.0 : 1.0;
        for (uint32_t p = 0; p < planes; p++)
            sum[p] += weight * (double)work->map->planes[p][other];
        weights += weight;
    }
    for (uint32_t p = 0; p < planes; p++)
        work->map->planes[p][texel] = (float)(sum[p] / weights);
}

static void fill_charts(struct layers *work)
{
    const size_t count = kiln_map_texels(work->map);
    for (size_t i = 0; i < count; i++)
        work->known[i] = work->map->state[i] == KILN_TEXEL_VALID;
    for (size_t i = 0; i < count; i++)
        if (work->map->state[i] == KILN_TEXEL_VALID)
            spread(work, (uint32_t)i);
    while (work->next_count > 0) {
        uint32_t *swap = work->layer;
        work->layer = work->next;
        work->layer_count = work->next_count;
        work->next = swap;
        work->next_count = 0;
        for (size_t i = 0; i < work->layer_count; i++)
            take_mean(work, work->layer[i]);
        for (size_t i = 0; i < work->layer_count; i++)
            work->known[work->layer[i]] = 1;
        for (size_t i = 0; i < work->layer_count; i++)
            spread(work, work->layer[i]);
    }
}

/* Fills charts without valid texels. */
static int fill_rest(struct layers *work, size_t left, struct kiln_error *error)
{
    struct kiln_map *map = work->map;
    const size_t count = kiln_map_texels(map);
    uint32_t *nearest = NULL;
    if (left == 0)
        return KILN_OK;
    int status = kiln_allocate(&nearest, count, sizeof *nearest, "nearest texels", error);
    if (status == KILN_OK)
        status = kiln_nearest_texels(work->known, 1, map->width, map->height, nearest, error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        if (map->state[i] != KILN_TEXEL_FILLED || work->known[i] != 0 || nearest[i] == KILN_NONE)
            continue;
        for (uint32_t p = 0; p < map->has->count; p++)
            map->planes[p][i] = map->planes[p][nearest[i]];
    }
    kiln_free(&nearest);
    return status;
}

int kiln_map_fill(struct kiln_map *map, struct kiln_error *error)
{
    const size_t count = kiln_map_texels(map);
    size_t invalid = 0;
    for (size_t i = 0; i < count; i++)
        invalid += map->state[i] == KILN_TEXEL_FILLED;
    if (invalid == 0)
        return KILN_OK;
    struct layers work = {.map = map};
    int status = kiln_allocate(&work.known, count, 1, "known texels", error);
    if (status == KILN_OK)
        status = kiln_allocate(&work.layer, invalid, sizeof(uint32_t), "texels to fill", error);
    if (status == KILN_OK)
        status = kiln_allocate(&work.next, invalid, sizeof(uint32_t), "texels to fill", error);
    if (status == KILN_OK) {
        for (size_t i = 0; i < count; i++)
            for (uint32_t p = 0; map->state[i] == KILN_TEXEL_FILLED && p < map->has->count; p++)
                map->planes[p][i] = 0.0f;
        fill_charts(&work);
        size_t left = 0;
        for (size_t i = 0; i < count; i++)
            left += map->state[i] == KILN_TEXEL_FILLED && work.known[i] == 0;
        status = fill_rest(&work, left, error);
    }
    kiln_free(&work.known);
    kiln_free(&work.layer);
    kiln_free(&work.next);
    return status;
}

static int run(struct kiln_map_work *work, struct kiln_error *error) { return kiln_map_fill(work->map, error); }

const struct kiln_map_stage kiln_map_stage_fill = {.name = "fill", .features = KILN_MAP_CHARTS, .run = run};
