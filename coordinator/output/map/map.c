#include "coordinator/output/map/map.h"

#include <string.h>

#include "worker/base/memory.h"
#include "worker/scene/scene.h"

const struct kiln_map_planes kiln_map_light = {.count = KILN_MAP_PLANES,
                                               .smooth = {true, true, true, true, true, true, false}};

int kiln_map_create(struct kiln_map **map, uint32_t width, uint32_t height, const struct kiln_map_planes *planes,
                    struct kiln_error *error)
{
    *map = NULL;
    if ((uint64_t)width * height >= UINT32_MAX)
        return kiln_fail(error, KILN_CANNOT_CREATE,
                         "a lightmap of %u x %u texels is too large: at most 2^32 - 2 texels", width, height);
    int status = kiln_allocate(map, 1, sizeof **map, "a lightmap", error);
    if (status != KILN_OK)
        return status;
    struct kiln_map *made = *map;
    made->width = width;
    made->height = height;
    made->has = *planes;
    const size_t count = kiln_map_texels(made);
    for (uint32_t p = 0; status == KILN_OK && p < planes->count; p++)
        status = kiln_allocate(&made->planes[p], count, sizeof(float), "a lightmap's texels", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->area, count, sizeof(float), "a lightmap's areas", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->coverage, count, sizeof(float), "a lightmap's coverage", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->state, count, 1, "a lightmap's states", error);
    if (status == KILN_OK)
        status = kiln_allocate(&made->chart, count, sizeof(uint32_t), "a lightmap's charts", error);
    if (status != KILN_OK) {
        kiln_map_destroy(map);
        return status;
    }
    memset(made->chart, 0xff, count * sizeof *made->chart);
    return KILN_OK;
}

void kiln_map_destroy(struct kiln_map **map)
{
    if (*map == NULL)
        return;
    for (uint32_t p = 0; p < (*map)->has.count; p++)
        kiln_free(&(*map)->planes[p]);
    kiln_free(&(*map)->area);
    kiln_free(&(*map)->coverage);
    kiln_free(&(*map)->state);
    kiln_free(&(*map)->chart);
    kiln_free(map);
}

/* ---- fill ---- */

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
    const uint32_t planes = work->map->has.count;
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
        for (uint32_t p = 0; p < map->has.count; p++)
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
            for (uint32_t p = 0; map->state[i] == KILN_TEXEL_FILLED && p < map->has.count; p++)
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

/* ---- nearest texels ---- */

/* Finds for each texel of the columns [first, last) the nearest row of its column with a texel to find, or KILN_NONE.
 * Goes down and then up over whole rows, so that memory is accessed in order. */
static void nearest_rows(const uint8_t *state, uint8_t least, uint32_t width, uint32_t height, uint32_t first,
                         uint32_t last, uint32_t *row)
{
    for (uint32_t y = 0; y < height; y++) {
        const size_t line = (size_t)y * width;
        for (uint32_t x = first; x < last; x++)
            row[line + x] = state[line + x] >= least ? y : y > 0 ? row[line - width + x] : KILN_NONE;
    }
    for (uint32_t y = height > 0 ? height - 1 : 0; y-- > 0;) {
        const size_t line = (size_t)y * width;
        for (uint32_t x = first; x < last;
             x++) { /* the entry below already is the nearest row in both directions from there */
            const uint32_t below = row[line + width + x], here = row[line + x];
            if (below != KILN_NONE && below > y && (here == KILN_NONE || below - y < y - here))
                row[line + x] = below;
        }
    }
}

struct envelope {
    int64_t *site, *from; /* columns of the lower envelope, and the x at which each begins */
    int64_t *height;      /* squared distance to the nearest row of each column */
    int64_t count;
};

static int64_t parabola(const struct envelope *e, int64_t site, int64_t x)
{
    return (x - site) * (x - site) + e->height[site];
}

/* Computes the lower envelope of the columns' parabolas for one row. */
static void row_envelope(struct envelope *e, const uint32_t *row, int64_t y, int64_t width)
{
    e->count = 0;
    for (int64_t u = 0; u < width; u++) {
        if (row[u] == KILN_NONE)
            continue;
        e->height[u] = (y - (int64_t)row[u]) * (y - (int64_t)row[u]);
        while (e->count > 0 &&
               parabola(e, e->site[e->count - 1], e->from[e->count - 1]) > parabola(e, u, e->from[e->count - 1]))
            e->count--;
        if (e->count == 0) {
            e->site[0] = u;
            e->from[0] = 0;
            e->count = 1;
            continue;
        }
        const int64_t i = e->site[e->count - 1];
        const int64_t start = 1 + (u * u - i * i + e->height[u] - e->height[i]) / (2 * (u - i));
        if (start < width) {
            e->site[e->count] = u;
            e->from[e->count] = start;
            e->count++;
        }
    }
}

static void nearest_in_row(struct envelope *e, uint32_t *row, uint32_t *out, uint32_t y, uint32_t width)
{
    memcpy(row, out, width * sizeof *row);
    row_envelope(e, row, y, width);
    int64_t at = e->count - 1;
    for (int64_t x = (int64_t)width - 1; at >= 0 && x >= 0; x--) {
        out[x] = row[e->site[at]] * width + (uint32_t)e->site[at];
        if (x == e->from[at])
            at--;
    }
}

/* Processes all rows in parallel; each thread has its own scratch memory. */
static int nearest_in_rows(uint32_t *nearest, uint32_t width, uint32_t height, struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel
    {
        struct kiln_error mine = {{0}};
        struct envelope e = {0};
        uint32_t *row = NULL;
        int64_t *scratch = NULL;
        int result = kiln_allocate(&scratch, 3 * (size_t)width, sizeof *scratch, "a distance transform", &mine);
        if (result == KILN_OK)
            result = kiln_allocate(&row, width, sizeof *row, "a distance transform", &mine);
        if (result == KILN_OK)
            e = (struct envelope){.site = scratch, .from = scratch + width, .height = scratch + 2 * (size_t)width};
        else
#pragma omp critical(kiln_nearest_in_rows)
            status = kiln_fail(error, result, "%s", mine.message);
#pragma omp barrier
        const bool ready = status == KILN_OK;
#pragma omp for schedule(static)
        for (uint32_t y = 0; y < height; y++)
            if (ready)
                nearest_in_row(&e, row, nearest + (size_t)y * width, y, width);
        kiln_free(&scratch);
        kiln_free(&row);
    }
    return status;
}

int kiln_nearest_texels(const uint8_t *state, uint8_t least, uint32_t width, uint32_t height, uint32_t *nearest,
                        struct kiln_error *error)
{
    const uint32_t at_once = 256, blocks = (width + at_once - 1) / at_once;
#pragma omp parallel for schedule(static)
    for (uint32_t b = 0; b < blocks; b++)
        nearest_rows(state, least, width, height, b * at_once, (b + 1) * at_once < width ? (b + 1) * at_once : width,
                     nearest);
    return nearest_in_rows(nearest, width, height, error);
}

uint64_t kiln_map_dilate(struct kiln_map *map, const uint32_t *nearest)
{
    const size_t count = kiln_map_texels(map);
    uint64_t dilated = 0;
#pragma omp parallel for schedule(static) reduction(+ : dilated)
    for (size_t i = 0; i < count; i++) {
        if (map->state[i] != KILN_TEXEL_MARGIN || nearest[i] == KILN_NONE)
            continue;
        for (uint32_t p = 0; p < map->has.count; p++)
            map->planes[p][i] = map->planes[p][nearest[i]];
        dilated++;
    }
    return dilated;
}
