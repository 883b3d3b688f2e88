#include "coordinator/output/map/charts/nearest.h"

#include <string.h>

#include "coordinator/output/map/bands/bands.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

/* The rows [top, end) of an image. For each column, `above` and `below` give the last row above them and the first row
 * below them with a texel to find (NULL: there are none). */
struct rows {
    const uint8_t *state;
    uint8_t least;
    uint32_t width, top, end;
    const uint32_t *above, *below;
};

/* Finds for each texel of the columns [first, last) the nearest row of its column with a texel to find, or KILN_NONE.
 * Goes down and then up over whole rows, so that memory is accessed in order. */
static void nearest_rows(const struct rows *r, uint32_t first, uint32_t last, uint32_t *row)
{
    const uint32_t width = r->width;
    for (uint32_t y = r->top; y < r->end; y++) {
        const size_t line = (size_t)y * width;
        for (uint32_t x = first; x < last; x++)
            row[line + x] = r->state[line + x] >= r->least ? y
                            : y > r->top                   ? row[line - width + x]
                            : r->above != NULL             ? r->above[x]
                                                           : KILN_NONE;
    }
    for (uint32_t y = r->end; y-- > r->top;) {
        const size_t line = (size_t)y * width;
        if (y + 1 == r->end && r->below == NULL)
            continue;
        /* the entry below already is the nearest row in both directions from there */
        const uint32_t *next = y + 1 < r->end ? row + line + width : r->below;
        for (uint32_t x = first; x < last; x++) {
            const uint32_t below = next[x], here = row[line + x];
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
static int nearest_in_rows(const struct rows *r, uint32_t *nearest, struct kiln_error *error)
{
    const uint32_t width = r->width;
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
        for (uint32_t y = r->top; y < r->end; y++)
            if (ready)
                nearest_in_row(&e, row, nearest + (size_t)y * width, y, width);
        kiln_free(&scratch);
        kiln_free(&row);
    }
    return status;
}

static int nearest_texels(const struct rows *r, uint32_t *nearest, struct kiln_error *error)
{
    const uint32_t width = r->width, at_once = 256, blocks = (width + at_once - 1) / at_once;
#pragma omp parallel for schedule(static)
    for (uint32_t b = 0; b < blocks; b++)
        nearest_rows(r, b * at_once, (b + 1) * at_once < width ? (b + 1) * at_once : width, nearest);
    return nearest_in_rows(r, nearest, error);
}

int kiln_nearest_texels(const uint8_t *state, uint8_t least, uint32_t width, uint32_t height, uint32_t *nearest,
                        struct kiln_error *error)
{
    return nearest_texels(&(struct rows){.state = state, .least = least, .width = width, .end = height}, nearest,
                          error);
}

/* The last and the first row of a map's own with a texel to find, of each column. */
static void find_ends(const struct rows *r, uint32_t *last, uint32_t *first)
{
    for (uint32_t y = r->top; y < r->end; y++)
        for (uint32_t x = 0; x < r->width; x++)
            if (r->state[(size_t)y * r->width + x] >= r->least) {
                last[x] = y;
                first[x] = first[x] == KILN_NONE ? y : first[x];
            }
}

int kiln_map_nearest(const struct kiln_map *map, const uint8_t *state, uint8_t least, uint32_t *nearest,
                     struct kiln_error *error)
{
    struct rows rows = {
        .state = state, .least = least, .width = map->width, .top = map->first_row, .end = map->end_row};
    uint32_t *ends = NULL;
    if (map->bands == NULL)
        return nearest_texels(&rows, nearest, error);
    int status = kiln_bands_agree(
        map, kiln_allocate(&ends, 2 * (size_t)map->width, sizeof *ends, "a distance transform", error), error);
    if (status == KILN_OK) {
        memset(ends, 0xff, 2 * map->width * sizeof *ends);
        find_ends(&rows, ends, ends + map->width);
        status = kiln_bands_around(map, ends, ends + map->width, error);
    }
    rows.above = ends;
    rows.below = ends + map->width;
    if (status == KILN_OK)
        status = kiln_bands_agree(map, nearest_texels(&rows, nearest, error), error);
    kiln_free(&ends);
    return status;
}
