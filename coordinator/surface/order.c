#include <stdlib.h>

#include "coordinator/surface/build.h"
#include "worker/base/memory.h"

enum { POINTS_PER_CELL = 1024 };

static uint64_t points_in(const struct kiln_part *part) { return (uint64_t)__builtin_popcountll(part->mask); }

static uint64_t block_count(const struct kiln_build *build) { return build->object_block[build->scene->object_count]; }

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

/* Lists the occupied cells' codes in order; gives the number of points too. */
static int list_cells(struct kiln_build *build, size_t *cells, uint64_t *points)
{
    size_t count = 0, capacity = 0;
    *points = 0;
    for (uint64_t b = 0; b < block_count(build); b++) {
        const struct kiln_block *block = &build->blocks[b];
        for (size_t i = 0; i < block->count; i++) {
            *points += points_in(&block->parts[i]);
            if (count > 0 && build->cell_codes[count - 1] == block->parts[i].code)
                continue;
            const int status = kiln_grow(&build->cell_codes, &capacity, count + 1, sizeof *build->cell_codes, "the occupied cells",
                                         build->error);
            if (status != KILN_OK)
                return status;
            build->cell_codes[count++] = block->parts[i].code;
        }
    }
    *cells = make_unique(build->cell_codes, count);
    return KILN_OK;
}

/* Joins the parts of each tile that now lie in one cell (`whole_tiles`: all of them, into the cell of the tile's first point).
 * Parts stand by their first points, and so do the joined ones. */
static void merge_parts(struct kiln_build *build, uint32_t shift, bool whole_tiles)
{
    const int team = (int)build->threads;
#pragma omp parallel for schedule(dynamic, 16) num_threads(team)
    for (uint64_t b = 0; b < block_count(build); b++) {
        struct kiln_block *block = &build->blocks[b];
        size_t kept = 0, tile_first = 0;
        for (size_t i = 0; i < block->count; i++) {
            struct kiln_part part = block->parts[i];
            part.code >>= shift;
            if (kept > 0 && block->parts[kept - 1].tile != part.tile)
                tile_first = kept;
            size_t at = tile_first;
            while (at < kept && !whole_tiles && block->parts[at].code != part.code)
                at++;
            if (at == kept) {
                block->parts[kept++] = part;
                continue;
            }
            block->parts[at].mask |= part.mask;
            block->parts[at].pieces += part.pieces;
            block->parts[at].shares += part.shares;
        }
        block->count = kept;
    }
}

/* Settles on the grid, lists its occupied cells in order and gives each part its cell's index. Where the size is ours to
 * choose, cells are doubled until an occupied one holds enough points on the mean: below that, fragments get small. */
static int rank_cells(struct kiln_build *build)
{
    size_t cells;
    uint64_t points;
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
        return kiln_fail(build->error, KILN_BAD_INPUT, "%zu cells are occupied and kiln can hold %u: give a larger --cell-size",
                         cells, UINT32_MAX - 1);
    build->surface->cell_count = cells;
    if (shift > 0)
        merge_parts(build, shift, false);
    const int team = (int)build->threads;
#pragma omp parallel for schedule(dynamic, 16) num_threads(team)
    for (uint64_t b = 0; b < block_count(build); b++) {
        for (size_t i = 0; i < build->blocks[b].count; i++) {
            struct kiln_part *part = &build->blocks[b].parts[i];
            const uint64_t *at = bsearch(&part->code, build->cell_codes, cells, sizeof *at, ascending);
            part->cell = (uint32_t)(at - build->cell_codes);
        }
    }
    return KILN_OK;
}

/* The unit that a rank should own whole: a cell or an object. */
static uint64_t unit_of(const struct kiln_build *build, const struct kiln_block *block, const struct kiln_part *part)
{
    return build->params->partition == KILN_PARTITION_CELLS ? part->cell : block->object;
}

struct units {
    uint64_t count;
    uint64_t *points;         /* unit: its points; unit_count */
    uint64_t *first_point;    /* unit_count + 1 */
    uint64_t *first_fragment; /* unit_count + 1 */
};

static int count_units(const struct kiln_build *build, struct units *units)
{
    const char *what = "the units of the partition";
    units->count =
        build->params->partition == KILN_PARTITION_CELLS ? build->surface->cell_count : (uint64_t)build->scene->object_count;
    int status = kiln_allocate(&units->points, units->count, sizeof *units->points, what, build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&units->first_point, units->count + 1, sizeof *units->first_point, what, build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&units->first_fragment, units->count + 1, sizeof *units->first_fragment, what, build->error);
    if (status != KILN_OK)
        return status;
    for (uint64_t b = 0; b < block_count(build); b++) {
        for (size_t i = 0; i < build->blocks[b].count; i++) {
            const struct kiln_part *part = &build->blocks[b].parts[i];
            const uint64_t unit = unit_of(build, &build->blocks[b], part);
            units->points[unit] += points_in(part);
            units->first_fragment[unit + 1]++;
        }
    }
    for (uint64_t u = 0; u < units->count; u++) {
        units->first_point[u + 1] = units->first_point[u] + units->points[u];
        units->first_fragment[u + 1] += units->first_fragment[u];
    }
    return KILN_OK;
}

/* Gives every part its place in global order. Parts stand by object and tile already, so a stable counting sort by unit is
 * one walk with a cursor for each unit. */
static int number_parts(struct kiln_build *build, const struct units *units)
{
    uint64_t *fragment = NULL, *point = NULL;
    int status = kiln_allocate(&fragment, units->count, sizeof *fragment, "the global order", build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&point, units->count, sizeof *point, "the global order", build->error);
    if (status != KILN_OK)
        goto end;
    for (uint64_t u = 0; u < units->count; u++) {
        fragment[u] = units->first_fragment[u];
        point[u] = units->first_point[u];
    }
    for (uint64_t b = 0; b < block_count(build); b++) {
        for (size_t i = 0; i < build->blocks[b].count; i++) {
            struct kiln_part *part = &build->blocks[b].parts[i];
            const uint64_t unit = unit_of(build, &build->blocks[b], part);
            part->position = fragment[unit]++;
            part->first = point[unit];
            point[unit] += points_in(part);
        }
    }
end:
    kiln_free(&fragment);
    kiln_free(&point);
    return status;
}

/* Enters all parts into tiles and splits. */
static int fill_tiles(struct kiln_build *build)
{
    struct kiln_surface *s = build->surface;
    int status = kiln_allocate(&s->tiles, s->tile_count, sizeof *s->tiles, "the lightmap tiles", build->error);
    if (status != KILN_OK)
        return status;
    for (uint64_t pass = 0; pass < 2; pass++) {
        s->split_count = 0;
        for (uint64_t b = 0; b < block_count(build); b++) {
            const struct kiln_block *block = &build->blocks[b];
            struct kiln_tile *tiles = s->tiles + s->lightmaps[block->object].tile_first;
            for (size_t i = 0, next; i < block->count; i = next) {
                const uint32_t tile = block->parts[i].tile;
                for (next = i + 1; next < block->count && block->parts[next].tile == tile; next++)
                    ;
                const bool split = next - i > 1;
                tiles[tile].first = split ? KILN_TILE_SPLIT | s->split_count : block->parts[i].first;
                for (size_t k = i; k < next; k++) {
                    tiles[tile].mask |= block->parts[k].mask;
                    if (split && pass == 1)
                        s->splits[s->split_count] = (struct kiln_tile_part){block->parts[k].mask, block->parts[k].first};
                    s->split_count += split ? 1 : 0;
                }
            }
        }
        if (pass == 0)
            status = kiln_allocate(&s->splits, s->split_count, sizeof *s->splits, "the split lightmap tiles", build->error);
        if (status != KILN_OK)
            return status;
    }
    return KILN_OK;
}

/* Points of each fragment in global order. */
static int list_fragment_points(const struct kiln_build *build, uint64_t fragments, uint64_t **points)
{
    const int status = kiln_allocate(points, fragments, sizeof **points, "the points of all fragments", build->error);
    if (status != KILN_OK)
        return status;
    for (uint64_t b = 0; b < block_count(build); b++) {
        for (size_t i = 0; i < build->blocks[b].count; i++)
            (*points)[build->blocks[b].parts[i].position] = points_in(&build->blocks[b].parts[i]);
    }
    return KILN_OK;
}

/* Turns cuts between units into the points and fragments of each rank's begin; gives the largest share. */
static uint64_t largest_share(const uint64_t *first_point, const uint64_t *cuts, uint32_t ranks)
{
    uint64_t most = 0;
    for (uint32_t r = 0; r < ranks; r++) {
        const uint64_t share = first_point[cuts[r + 1]] - first_point[cuts[r]];
        most = share > most ? share : most;
    }
    return most;
}

static void report_balance(struct kiln_build *build, const uint64_t *first_point, const uint64_t *cuts)
{
    struct kiln_surface_report *report = build->report;
    const uint32_t ranks = build->params->ranks;
    report->points_min = UINT64_MAX;
    for (uint32_t r = 0; r < ranks; r++) {
        const uint64_t share = first_point[cuts[r + 1]] - first_point[cuts[r]];
        report->points_min = share < report->points_min ? share : report->points_min;
    }
    report->points_max = largest_share(first_point, cuts, ranks);
    if (build->surface->point_count > 0)
        report->imbalance = (double)report->points_max / ((double)build->surface->point_count / ranks) - 1.0;
}

/* Decides which fragments, in global order, are this rank's. */
static int cut_shares(struct kiln_build *build, const struct units *units, uint64_t *fragment_first, uint64_t *fragment_end)
{
    const uint32_t ranks = build->params->ranks, rank = build->params->rank;
    struct kiln_surface *s = build->surface;
    uint64_t *cuts = NULL, *points = NULL, *first_point = NULL;
    int status = kiln_allocate(&cuts, (size_t)ranks + 1, sizeof *cuts, "the partition", build->error);
    if (status != KILN_OK)
        goto end;
    kiln_partition_cut(units->points, units->count, ranks, cuts);
    const double mean = (double)s->point_count / ranks;
    if (ranks == 1 || s->point_count == 0 ||
        (units->count >= ranks && (double)largest_share(units->first_point, cuts, ranks) <= 1.1 * mean)) {
        *fragment_first = units->first_fragment[cuts[rank]];
        *fragment_end = units->first_fragment[cuts[rank + 1]];
        s->first = units->first_point[cuts[rank]];
        s->count = units->first_point[cuts[rank + 1]] - s->first;
        report_balance(build, units->first_point, cuts);
        goto end;
    }
    const uint64_t fragments = build->report->fragments;
    status = list_fragment_points(build, fragments, &points);
    if (status == KILN_OK)
        status = kiln_allocate(&first_point, fragments + 1, sizeof *first_point, "the points of all fragments", build->error);
    if (status != KILN_OK)
        goto end;
    kiln_partition_cut(points, fragments, ranks, cuts);
    for (uint64_t f = 0; f < fragments; f++)
        first_point[f + 1] = first_point[f] + points[f];
    *fragment_first = cuts[rank];
    *fragment_end = cuts[rank + 1];
    s->first = first_point[cuts[rank]];
    s->count = first_point[cuts[rank + 1]] - s->first;
    report_balance(build, first_point, cuts);
end:
    kiln_free(&cuts);
    kiln_free(&points);
    kiln_free(&first_point);
    return status;
}

static int take_fragments(struct kiln_build *build, uint64_t fragment_first, uint64_t fragment_end)
{
    struct kiln_surface *s = build->surface;
    s->fragment_count = fragment_end - fragment_first;
    int status = kiln_allocate(&s->fragments, s->fragment_count, sizeof *s->fragments, "the fragments", build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->piece_base, s->fragment_count + 1, sizeof *s->piece_base, "the fragments", build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->share_base, s->fragment_count + 1, sizeof *s->share_base, "the fragments", build->error);
    if (status != KILN_OK)
        return status;
    for (uint64_t b = 0; b < block_count(build); b++) {
        const struct kiln_block *block = &build->blocks[b];
        for (size_t i = 0; i < block->count; i++) {
            const struct kiln_part *part = &block->parts[i];
            if (part->position < fragment_first || part->position >= fragment_end)
                continue;
            const uint64_t f = part->position - fragment_first;
            s->fragments[f] = (struct kiln_fragment){.first = part->first,
                                                     .mask = part->mask,
                                                     .object = block->object,
                                                     .tile = part->tile,
                                                     .cell = part->cell,
                                                     .count = (uint32_t)points_in(part)};
            s->piece_base[f + 1] = part->pieces;
            s->share_base[f + 1] = part->shares;
        }
    }
    for (size_t f = 0; f < s->fragment_count; f++) {
        s->piece_base[f + 1] += s->piece_base[f];
        s->share_base[f + 1] += s->share_base[f];
    }
    return KILN_OK;
}

int kiln_build_order(struct kiln_build *build)
{
    struct kiln_surface *s = build->surface;
    struct units units = {0};
    uint64_t fragment_first = 0, fragment_end = 0;
    int status = rank_cells(build);
    if (status == KILN_OK && build->params->partition == KILN_PARTITION_OBJECTS)
        merge_parts(build, 0, true);
    if (status == KILN_OK)
        status = count_units(build, &units);
    if (status != KILN_OK)
        goto end;
    s->point_count = units.first_point[units.count];
    build->report->points = s->point_count;
    build->report->fragments = units.first_fragment[units.count];
    status = number_parts(build, &units);
    if (status == KILN_OK)
        status = fill_tiles(build);
    if (status == KILN_OK)
        status = cut_shares(build, &units, &fragment_first, &fragment_end);
    if (status == KILN_OK)
        status = take_fragments(build, fragment_first, fragment_end);
    if (status == KILN_OK && build->params->partition == KILN_PARTITION_CELLS) {
        s->cell_first = units.first_point;
        units.first_point = NULL;
    }
end:
    kiln_free(&units.points);
    kiln_free(&units.first_point);
    kiln_free(&units.first_fragment);
    return status;
}
