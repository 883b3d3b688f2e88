#include <stdlib.h>
#include <string.h>

#include "coordinator/surface/build.h"
#include "worker/base/memory.h"

enum { POINTS_PER_CELL = 1024 }; /* mean over occupied cells that an automatic cell size aims at */

static int ascending(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y ? 1 : 0;
}

/* Sorts codes and drops repeated ones; gives how many are left. */
static size_t make_unique(uint64_t *codes, size_t count)
{
    size_t kept = 0;
    if (count > 0)
        qsort(codes, count, sizeof *codes, ascending);
    for (size_t i = 0; i < count; i++) {
        if (kept == 0 || codes[kept - 1] != codes[i])
            codes[kept++] = codes[i];
    }
    return kept;
}

/* The Morton codes of the cells that this rank's unplaced runs lie in, ascending; and the number of their points. */
static int list_own_cells(const struct kiln_build *build, uint64_t **codes, size_t *cells, uint64_t *points)
{
    size_t count = 0, capacity = 0;
    *points = 0;
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        const struct kiln_tile_range *tile_range = &build->tile_ranges[b];
        for (size_t i = 0; i < tile_range->count; i++) {
            *points += kiln_unplaced_run_points(&tile_range->runs[i]);
            if (count > 0 && (*codes)[count - 1] == tile_range->runs[i].code)
                continue;
            const int status =
                kiln_grow(codes, &capacity, count + 1, sizeof **codes, "the occupied cells", build->error);
            if (status != KILN_OK)
                return status;
            (*codes)[count++] = tile_range->runs[i].code;
        }
    }
    *cells = make_unique(*codes, count);
    return KILN_OK;
}

struct code_list {
    uint64_t *codes;
    size_t count;
};

/* kiln_surface_taker for a struct code_list with room for the codes of all ranks */
static void receive_codes(void *taker, const void *records, size_t count)
{
    struct code_list *list = taker;
    memcpy(list->codes + list->count, records, count * sizeof *list->codes);
    list->count += count;
}

/* Lists the codes of all occupied cells, ascending, in build->cell_codes; also gives the number of all points.
 * Collective. */
static int list_cells(struct kiln_build *build, size_t *cells, uint64_t *points)
{
    const struct kiln_surface_exchange *x = build->exchange;
    uint64_t *own = NULL;
    size_t count = 0;
    int status = list_own_cells(build, &own, &count, points);
    uint64_t sums[2] = {count, *points};
    status = x->sum(x->context, status, sums, NULL, 2, build->error);
    if (status != KILN_OK)
        goto end;
    struct code_list list = {NULL, 0};
    status = kiln_allocate(&list.codes, sums[0], sizeof *list.codes, "the occupied cells", build->error);
    build->cell_codes = list.codes;
    status = x->allgather(x->context, status, own, count, sizeof *own, receive_codes, &list, build->error);
    if (status != KILN_OK)
        goto end;
    *cells = make_unique(list.codes, list.count);
    *points = sums[1];
end:
    kiln_free(&own);
    return status;
}

/* Joins the runs of each tile that lie in one cell once codes are shifted right by `shift`. With `whole_tiles`, joins
 * all runs of a tile into the cell of the tile's first point. The runs of a tile are in order of their first points,
 * before and after. */
static void merge_runs(struct kiln_build *build, uint32_t shift, bool whole_tiles)
{
    const int team = (int)build->threads;
#pragma omp parallel for schedule(dynamic, 16) num_threads(team)
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        struct kiln_tile_range *tile_range = &build->tile_ranges[b];
        size_t kept = 0, tile_first = 0;
        for (size_t i = 0; i < tile_range->count; i++) {
            struct kiln_unplaced_run run = tile_range->runs[i];
            run.code >>= shift;
            if (kept > 0 && tile_range->runs[kept - 1].tile != run.tile)
                tile_first = kept;
            size_t at = tile_first;
            while (at < kept && !whole_tiles && tile_range->runs[at].code != run.code)
                at++;
            if (at == kept) {
                tile_range->runs[kept++] = run;
                continue;
            }
            tile_range->runs[at].mask |= run.mask;
            tile_range->runs[at].pieces += run.pieces;
            tile_range->runs[at].cdf_entries += run.cdf_entries;
        }
        tile_range->count = kept;
    }
}

/* Chooses the cell size, lists the occupied cells and gives each run its cell's index. Collective. Where the cell size
 * is automatic, it is doubled until the occupied cells hold POINTS_PER_CELL points on average: smaller cells make small
 * tile runs. */
static int number_cells(struct kiln_build *build)
{
    size_t cells;
    uint64_t points;
    if (build->params->whole_tiles)
        merge_runs(build, 0, true);
    int status = list_cells(build, &cells, &points);
    if (status != KILN_OK)
        return status;
    uint32_t shift = 0;
    while (build->params->cell_size == 0.0 && cells > 1 && points / cells < POINTS_PER_CELL) {
        for (size_t i = 0; i < cells; i++)
            build->cell_codes[i] >>= 3;
        cells = make_unique(build->cell_codes, cells);
        kiln_grid_coarsen(&build->grid);
        shift += 3;
    }
    if (cells >= UINT32_MAX)
        return kiln_fail(build->error, KILN_BAD_INPUT,
                         "%zu cells contain geometry, and at most %u are possible: give a larger --cell-size", cells,
                         UINT32_MAX - 1);
    build->surface->cell_count = cells;
    if (shift > 0)
        merge_runs(build, shift, false);
    const int team = (int)build->threads;
#pragma omp parallel for schedule(dynamic, 16) num_threads(team)
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        for (size_t i = 0; i < build->tile_ranges[b].count; i++) {
            struct kiln_unplaced_run *run = &build->tile_ranges[b].runs[i];
            const uint64_t *at = bsearch(&run->code, build->cell_codes, cells, sizeof *at, ascending);
            run->cell = (uint32_t)(at - build->cell_codes);
        }
    }
    return KILN_OK;
}

static uint64_t unit_of(const struct kiln_build *build, const struct kiln_tile_range *tile_range,
                        const struct kiln_unplaced_run *run)
{
    return build->params->partition == KILN_PARTITION_CELLS ? run->cell : tile_range->map;
}

/* Gives this rank's runs their places in the global order. The runs of all ranks, in order of ranks, are already sorted
 * by object and tile. So a stable counting sort by unit is one walk with a cursor for each unit: point[unit] and
 * tile_run[unit] start where the ranks before this one end. */
static void number_runs(struct kiln_build *build, uint64_t *point, uint64_t *tile_run)
{
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        for (size_t i = 0; i < build->tile_ranges[b].count; i++) {
            struct kiln_unplaced_run *run = &build->tile_ranges[b].runs[i];
            const uint64_t unit = unit_of(build, &build->tile_ranges[b], run);
            run->position = tile_run[unit]++;
            run->first = point[unit];
            point[unit] += kiln_unplaced_run_points(run);
        }
    }
}

static int allocate_units(struct kiln_build *build, uint64_t **sums, uint64_t **before)
{
    const char *what = "the units of the partition";
    struct kiln_units *units = &build->units;
    units->count = build->params->partition == KILN_PARTITION_CELLS ? build->surface->cell_count
                                                                    : (uint64_t)build->surface->map_count;
    int status;
    KILN_TRY(kiln_allocate(&units->points, units->count, sizeof *units->points, what, build->error));
    KILN_TRY(kiln_allocate(&units->first_point, units->count + 1, sizeof *units->first_point, what, build->error));
    KILN_TRY(
        kiln_allocate(&units->first_tile_run, units->count + 1, sizeof *units->first_tile_run, what, build->error));
    KILN_TRY(kiln_allocate(sums, 2 * units->count, sizeof **sums, what, build->error));
    KILN_TRY(kiln_allocate(before, 2 * units->count, sizeof **before, what, build->error));
end:
    return status;
}

/* Sums the points and tile runs of each unit over all ranks and numbers this rank's runs. Collective. */
static int place_runs(struct kiln_build *build, int status)
{
    const struct kiln_surface_exchange *x = build->exchange;
    struct kiln_units *units = &build->units;
    uint64_t *sums = NULL, *before = NULL; /* the points of each unit, then the tile runs of each unit */
    if (status == KILN_OK)
        status = allocate_units(build, &sums, &before);
    const uint64_t count = units->count;
    for (uint64_t b = build->own_first; b < build->own_end && status == KILN_OK; b++) {
        for (size_t i = 0; i < build->tile_ranges[b].count; i++) {
            const struct kiln_unplaced_run *run = &build->tile_ranges[b].runs[i];
            const uint64_t unit = unit_of(build, &build->tile_ranges[b], run);
            sums[unit] += kiln_unplaced_run_points(run);
            sums[count + unit]++;
        }
    }
    status = x->sum(x->context, status, sums, before, 2 * count, build->error);
    if (status != KILN_OK)
        goto end;
    for (uint64_t u = 0; u < count; u++) {
        units->points[u] = sums[u];
        units->first_point[u + 1] = units->first_point[u] + sums[u];
        units->first_tile_run[u + 1] = units->first_tile_run[u] + sums[count + u];
        before[u] += units->first_point[u];
        before[count + u] += units->first_tile_run[u];
    }
    number_runs(build, before, before + count);
end:
    kiln_free(&sums);
    kiln_free(&before);
    return status;
}

/* An entry of the map of tiles as it is sent: entry `place` of `tiles` or, from tile_count on, entry place - tile_count
 * of `splits`. */
struct map_entry {
    uint64_t place, mask, first;
};

/* kiln_surface_taker for a struct kiln_surface */
static void receive_entries(void *taker, const void *records, size_t count)
{
    struct kiln_surface *s = taker;
    const struct map_entry *entries = records;
    for (size_t i = 0; i < count; i++) {
        const struct map_entry *e = &entries[i];
        if (e->place < s->tile_count)
            s->tiles[e->place] = (struct kiln_tile){e->mask, e->first};
        else
            s->splits[e->place - s->tile_count] = (struct kiln_split_tile_run){e->mask, {e->first}};
    }
}

/* Where map entries go: into the list that is sent to all ranks or, in a process that works alone, straight to their
 * places. */
struct map_writer {
    struct kiln_surface *surface;
    struct map_entry *list; /* NULL: none */
    size_t count;
    uint64_t split; /* index of the next entry of `splits` */
};

static void write_entry(struct map_writer *writer, uint64_t place, uint64_t mask, uint64_t first)
{
    const struct map_entry entry = {place, mask, first};
    if (writer->list != NULL)
        writer->list[writer->count++] = entry;
    else
        receive_entries(writer->surface, &entry, 1);
}

/* Number of the range's runs, from run `i` on, that belong to one tile. */
static size_t runs_of_tile(const struct kiln_tile_range *tile_range, size_t i)
{
    size_t next = i + 1;
    while (next < tile_range->count && tile_range->runs[next].tile == tile_range->runs[i].tile)
        next++;
    return next - i;
}

static void write_block(struct map_writer *writer, const struct kiln_tile_range *tile_range)
{
    const struct kiln_surface *s = writer->surface;
    for (size_t i = 0, count; i < tile_range->count; i += count) {
        const struct kiln_unplaced_run *runs = &tile_range->runs[i];
        uint64_t mask = 0;
        count = runs_of_tile(tile_range, i);
        for (size_t k = 0; k < count; k++)
            mask |= runs[k].mask;
        write_entry(writer, s->lightmaps[tile_range->map].tile_first + runs->tile, mask,
                    count > 1 ? KILN_TILE_SPLIT | writer->split : runs->first);
        for (size_t k = 0; k < count && count > 1; k++)
            write_entry(writer, s->tile_count + writer->split++, runs[k].mask, runs[k].first);
    }
}

/* Fills the map of tiles and splits on all ranks from their runs. Entries of `splits` are in the order of ranges.
 * Collective. */
static int fill_map(struct kiln_build *build, int status)
{
    const struct kiln_surface_exchange *x = build->exchange;
    struct kiln_surface *s = build->surface;
    uint64_t splits = 0, before = 0;
    size_t entries = 0;
    for (uint64_t b = build->own_first; b < build->own_end && status == KILN_OK; b++) {
        const struct kiln_tile_range *tile_range = &build->tile_ranges[b];
        for (size_t i = 0, count; i < tile_range->count; i += count) {
            count = runs_of_tile(tile_range, i);
            splits += count > 1 ? count : 0;
            entries += count > 1 ? count + 1 : 1;
        }
    }
    status = x->sum(x->context, status, &splits, &before, 1, build->error);
    if (status != KILN_OK)
        return status;
    struct map_writer writer = {.surface = s, .split = before};
    s->split_count = splits;
    status = kiln_allocate(&s->tiles, s->tile_count, sizeof *s->tiles, "the lightmap tiles", build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->splits, s->split_count, sizeof *s->splits, "the split lightmap tiles", build->error);
    if (status == KILN_OK && build->workers > 1)
        status = kiln_allocate(&writer.list, entries, sizeof *writer.list, "the lightmap tiles to send", build->error);
    for (uint64_t b = build->own_first; b < build->own_end && status == KILN_OK; b++)
        write_block(&writer, &build->tile_ranges[b]);
    status = x->allgather(x->context, status, writer.list, writer.count, sizeof *writer.list, receive_entries, s,
                          build->error);
    kiln_free(&writer.list);
    return status;
}

int kiln_build_order(struct kiln_build *build)
{
    int status = number_cells(build);
    if (status == KILN_OK && build->params->partition == KILN_PARTITION_OBJECTS)
        merge_runs(build, 0, true);
    status = place_runs(build, status);
    if (status != KILN_OK)
        return status;
    build->surface->point_count = build->units.first_point[build->units.count];
    build->report->points = build->surface->point_count;
    build->report->tile_runs = build->units.first_tile_run[build->units.count];
    return fill_map(build, KILN_OK);
}
