#include "coordinator/surface/parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

static const char *const WHAT = "the parts of texels";

/* A new point. */
struct extra {
    uint64_t cell, order; /* sort key: cell, place of the tile in Morton order, `map`, `bit` */
    uint32_t map, bit;
    uint32_t tile, part;
    size_t texel; /* index among the texels */
    uint64_t point;
};

/* A tile run of new points. */
struct group {
    size_t first, count; /* among the extras */
    uint64_t end;        /* end of its cell in the old numbering of points */
    uint64_t tile;       /* index in the surface's tiles */
    struct kiln_tile_run run;
};

/* A contiguous range of a rank's points: an old tile run, or a new one. */
struct span {
    bool is_new;
    size_t index; /* among the surface's old tile runs, or among the groups */
};

struct adding {
    struct kiln_surface *s;
    struct kiln_subtexel_set *texels;
    size_t count;
    struct kiln_subtexel_piece *pieces;
    size_t piece_count;
    struct extra *extras;
    size_t extra_count;
    struct group *groups;
    size_t group_count;
    struct span *spans;
    size_t span_count;
    uint64_t point_count; /* of the surface so far */
    struct kiln_arena arena;
};

/* ---- order ---- */

static int compare(uint64_t a, uint64_t b) { return a < b ? -1 : a > b ? 1 : 0; }

static int by_texel(const void *a, const void *b)
{
    const struct kiln_subtexel_set *x = a, *y = b;
    return compare(x->divided.part[0].at, y->divided.part[0].at);
}

static int by_piece(const void *a, const void *b)
{
    const struct kiln_subtexel_piece *x = a, *y = b;
    const int point = compare(x->point, y->point), part = compare(x->part, y->part);
    return point != 0 ? point : part != 0 ? part : compare(x->triangle, y->triangle);
}

static int by_order(const void *a, const void *b)
{
    const struct extra *x = a, *y = b;
    const int cell = compare(x->cell, y->cell), map = compare(x->map, y->map), tile = compare(x->order, y->order);
    return cell != 0 ? cell : map != 0 ? map : tile != 0 ? tile : compare(x->bit, y->bit);
}

static int by_tile(const void *a, const void *b)
{
    const struct group *const *x = a, *const *y = b;
    return compare((*x)->tile, (*y)->tile) != 0 ? compare((*x)->tile, (*y)->tile)
                                                : compare((*x)->run.first.at, (*y)->run.first.at);
}

static int by_point(const void *a, const void *b)
{
    const struct kiln_subtexel *x = a, *y = b;
    return compare(x->point.at, y->point.at);
}

static uint64_t spread_bits(uint32_t x)
{
    uint64_t wide = x;
    for (int shift = 16; shift > 0; shift /= 2) {
        static const uint64_t masks[] = {[16] = 0x0000ffff0000ffffull,
                                         [8] = 0x00ff00ff00ff00ffull,
                                         [4] = 0x0f0f0f0f0f0f0f0full,
                                         [2] = 0x3333333333333333ull,
                                         [1] = 0x5555555555555555ull};
        wide = (wide | wide << shift) & masks[shift];
    }
    return wide;
}

/* The place of a tile in Morton order; bricks are numbered in that order. */
static uint64_t order_of(const struct kiln_surface *s, uint32_t map, uint32_t tile)
{
    const uint32_t across = s->lightmaps[map].tiles_x;
    return s->bricks != NULL ? tile : spread_bits(tile % across) | spread_bits(tile / across) << 1;
}

static int list_extras(struct adding *a, struct kiln_error *error)
{
    size_t count = 0;
    for (size_t i = 0; i < a->count; i++)
        count += a->texels[i].count - 1;
    const int status = kiln_arena_allocate(&a->arena, &a->extras, count, sizeof *a->extras, WHAT, error);
    for (size_t i = 0; i < a->count && status == KILN_OK; i++) {
        const struct kiln_subtexel_set *t = &a->texels[i];
        for (uint32_t k = 1; k < t->count; k++)
            a->extras[a->extra_count++] = (struct extra){.cell = a->s->cell_first != NULL ? t->cell : 0,
                                                         .map = t->map + k * a->s->whole_maps,
                                                         .order = order_of(a->s, t->map, t->tile),
                                                         .bit = t->divided.bit,
                                                         .tile = t->tile,
                                                         .part = k,
                                                         .texel = i};
    }
    if (a->extra_count > 0)
        qsort(a->extras, a->extra_count, sizeof *a->extras, by_order);
    return status;
}

static uint64_t end_of_cell(const struct adding *a, uint64_t cell)
{
    return a->s->cell_first != NULL ? a->s->cell_first[cell + 1] : a->point_count;
}

/* Number of new points before an old point: those in cells that end there or earlier. */
static uint64_t extras_before(const struct adding *a, uint64_t point)
{
    size_t low = 0, high = a->extra_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (end_of_cell(a, a->extras[middle].cell) <= point)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static bool is_same_run(const struct extra *x, const struct extra *y)
{
    return x->cell == y->cell && x->map == y->map && x->tile == y->tile;
}

static int group_extras(struct adding *a, struct kiln_error *error)
{
    const int status = kiln_arena_allocate(&a->arena, &a->groups, a->extra_count, sizeof *a->groups, WHAT, error);
    for (size_t i = 0; i < a->extra_count && status == KILN_OK; i++) {
        struct extra *x = &a->extras[i];
        const uint64_t end = end_of_cell(a, x->cell);
        x->point = end + i; /* all old points up to the end of the cell come before it, and i new ones */
        a->texels[x->texel].divided.part[x->part] = (struct kiln_global_point){x->point};
        if (i == 0 || !is_same_run(&a->extras[i - 1], x))
            a->groups[a->group_count++] = (struct group){
                .first = i,
                .end = end,
                .run = {.first = {x->point}, .map = x->map, .tile = x->tile, .cell = a->texels[x->texel].cell}};
        struct group *group = &a->groups[a->group_count - 1];
        group->count++;
        group->run.count++;
        group->run.mask |= 1ull << x->bit;
    }
    return status;
}

/* ---- global arrays ---- */

static uint64_t tiles_of(const struct kiln_lightmap *map) { return (uint64_t)map->tiles_x * map->tiles_y; }

/* Adds lightmaps for further parts: as large as that of part 0, where they have points. */
static int add_lightmaps(struct adding *a, struct kiln_error *error)
{
    struct kiln_surface *s = a->s;
    struct kiln_lightmap *maps = NULL;
    uint8_t *has = NULL;
    uint32_t layers = 1;
    for (size_t i = 0; i < a->count; i++)
        layers = a->texels[i].count > layers ? a->texels[i].count : layers;
    const size_t count = (size_t)layers * s->whole_maps;
    int status;
    KILN_TRY(kiln_allocate(&maps, count, sizeof *maps, "the lightmaps", error));
    KILN_TRY(kiln_allocate(&has, count, 1, "the lightmaps", error));
    for (size_t i = 0; i < a->extra_count; i++)
        has[a->extras[i].map] = 1;
    memcpy(maps, s->lightmaps, s->whole_maps * sizeof *maps);
    for (size_t m = s->whole_maps; m < count; m++) {
        maps[m] = has[m] != 0 ? maps[m % s->whole_maps] : (struct kiln_lightmap){0};
        maps[m].published = 0;
        maps[m].tile_first = s->tile_count;
        s->tile_count += tiles_of(&maps[m]);
    }
    kiln_free(&s->lightmaps);
    s->lightmaps = maps;
    s->map_count = (uint32_t)count;
    maps = NULL;
end:
    kiln_free(&maps);
    kiln_free(&has);
    return status;
}

/* Extends an array; new elements are 0. */
static int lengthen(void *pointer, uint64_t from, uint64_t to, size_t size, const char *what, struct kiln_error *error)
{
    void *old, *longer = NULL;
    memcpy(&old, pointer, sizeof old);
    const int status = kiln_allocate(&longer, to, size, what, error);
    if (status != KILN_OK)
        return status;
    if (from > 0)
        memcpy(longer, old, from * size);
    kiln_free(&old);
    memcpy(pointer, &longer, sizeof longer);
    return KILN_OK;
}

static int add_tiles(struct adding *a, uint64_t before, struct kiln_error *error)
{
    struct kiln_surface *s = a->s;
    int status;
    KILN_TRY(lengthen(&s->tiles, before, s->tile_count, sizeof *s->tiles, "the lightmap tiles", error));
    if (s->bricks != NULL)
        KILN_TRY(lengthen(&s->bricks, before, s->tile_count, sizeof *s->bricks, "the bricks", error));
    for (uint32_t m = s->whole_maps; s->bricks != NULL && m < s->map_count; m++)
        memcpy(s->bricks + s->lightmaps[m].tile_first, s->bricks + s->lightmaps[m % s->whole_maps].tile_first,
               tiles_of(&s->lightmaps[m]) * sizeof *s->bricks);
end:
    return status;
}

/* Renumbers the old points, to make room for new ones. */
static void number_anew(struct adding *a, uint64_t tiles)
{
    struct kiln_surface *s = a->s;
    for (uint64_t t = 0; t < tiles; t++)
        if (s->tiles[t].mask != 0 && (s->tiles[t].first & KILN_TILE_SPLIT) == 0)
            s->tiles[t].first += extras_before(a, s->tiles[t].first);
    for (uint64_t i = 0; i < s->split_count; i++)
        s->splits[i].first.at += extras_before(a, s->splits[i].first.at);
    for (size_t i = 0; i < a->count; i++)
        a->texels[i].divided.part[0].at += extras_before(a, a->texels[i].divided.part[0].at);
    s->point_count += a->extra_count;
}

/* Renumbers the first points of cells. Comes last, since all other functions need the old ends of cells. */
static void number_cells_anew(struct adding *a)
{
    struct kiln_surface *s = a->s;
    size_t before = 0;
    for (uint64_t c = 0; s->cell_first != NULL && c < s->cell_count; c++) {
        while (before < a->extra_count && a->extras[before].cell < c)
            before++;
        s->cell_first[c] += before;
    }
    if (s->cell_first != NULL)
        s->cell_first[s->cell_count] = s->point_count;
}

/* Number of entries that a tile has in `splits`; 0 if it has a single tile run. */
static uint64_t parts_of(const struct kiln_surface *s, const struct kiln_tile *tile)
{
    uint64_t parts = 0;
    if ((tile->first & KILN_TILE_SPLIT) != 0)
        for (uint64_t seen = 0; seen != tile->mask; parts++)
            seen |= s->splits[(tile->first & ~KILN_TILE_SPLIT) + parts].mask;
    return parts;
}

/* Size of `splits` with new entries: one for each new tile run, one for each divided texel, and copies of the old
 * entries of the divided texels' tiles. */
static uint64_t room_for_splits(const struct adding *a)
{
    uint64_t room = a->s->split_count + a->group_count;
    for (size_t i = 0; i < a->count; i++) {
        const uint64_t parts = parts_of(a->s, &a->s->tiles[a->texels[i].divided.tile]);
        room += 1 + (parts > 0 ? parts : 1);
    }
    return room;
}

/* The tiles of new points. */
static void enter_groups(struct adding *a, struct group *const *list)
{
    struct kiln_surface *s = a->s;
    for (size_t i = 0, next; i < a->group_count; i = next) {
        struct kiln_tile *tile = &s->tiles[list[i]->tile];
        for (next = i; next < a->group_count && list[next]->tile == list[i]->tile; next++)
            tile->mask |= list[next]->run.mask;
        tile->first = next - i > 1 ? KILN_TILE_SPLIT | s->split_count : list[i]->run.first.at;
        for (size_t k = i; k < next && next - i > 1; k++)
            s->splits[s->split_count++] = (struct kiln_split_tile_run){list[k]->run.mask, list[k]->run.first};
    }
}

/* A divided texel: its tile and bit, and its index among divided texels. */
struct entry {
    uint64_t tile, number;
    uint32_t bit;
};

static int by_entry(const void *a, const void *b)
{
    const struct entry *x = a, *y = b;
    return compare(x->tile, y->tile) != 0 ? compare(x->tile, y->tile) : compare(x->bit, y->bit);
}

/* Appends to `splits` new entries for each tile with divided texels: first its divided texels, then copies of its old
 * entries. */
static void enter_divided(struct adding *a, const struct entry *entries)
{
    struct kiln_surface *s = a->s;
    for (size_t i = 0; i < a->count;) {
        struct kiln_tile *tile = &s->tiles[entries[i].tile];
        const uint64_t number = entries[i].tile, begin = s->split_count, parts = parts_of(s, tile);
        for (; i < a->count && entries[i].tile == number; i++)
            s->splits[s->split_count++] =
                (struct kiln_split_tile_run){1ull << entries[i].bit, {KILN_TILE_SPLIT | entries[i].number}};
        for (uint64_t k = 0; k < parts; k++)
            s->splits[s->split_count++] = s->splits[(tile->first & ~KILN_TILE_SPLIT) + k];
        if (parts == 0)
            s->splits[s->split_count++] = (struct kiln_split_tile_run){tile->mask, {tile->first}};
        tile->first = KILN_TILE_SPLIT | begin;
    }
}

static int enter_all(struct adding *a, struct kiln_error *error)
{
    struct kiln_surface *s = a->s;
    struct group **list = NULL;
    struct entry *entries = NULL;
    int status = kiln_allocate(&list, a->group_count, sizeof *list, WHAT, error);
    if (status == KILN_OK)
        status = kiln_allocate(&entries, a->count, sizeof *entries, WHAT, error);
    if (status != KILN_OK)
        goto end;
    for (size_t i = 0; i < a->group_count; i++) {
        a->groups[i].tile = s->lightmaps[a->groups[i].run.map].tile_first + a->groups[i].run.tile;
        list[i] = &a->groups[i];
    }
    for (size_t i = 0; i < a->count; i++)
        entries[i] = (struct entry){a->texels[i].divided.tile, i, a->texels[i].divided.bit};
    if (a->group_count > 0)
        qsort(list, a->group_count, sizeof *list, by_tile);
    qsort(entries, a->count, sizeof *entries, by_entry);
    status =
        lengthen(&s->splits, s->split_count, room_for_splits(a), sizeof *s->splits, "the split lightmap tiles", error);
    if (status == KILN_OK) {
        enter_groups(a, list);
        enter_divided(a, entries);
    }
end:
    kiln_free(&list);
    kiln_free(&entries);
    return status;
}

/* Lists the divided texels by point, and their parts. */
static int list_parts(struct adding *a, struct kiln_error *error)
{
    struct kiln_surface *s = a->s;
    int status;
    KILN_TRY(kiln_allocate(&s->divided, a->count, sizeof *s->divided, "divided texels", error));
    KILN_TRY(kiln_allocate(&s->parts, a->count + a->extra_count, sizeof *s->parts, WHAT, error));
    for (size_t i = 0; i < a->count; i++) {
        s->divided[i] = a->texels[i].divided;
        for (uint32_t k = 0; k < a->texels[i].count; k++)
            s->parts[s->part_count++] =
                (struct kiln_subtexel){.point = a->texels[i].divided.part[k], .divided = i, .part = k};
    }
    s->divided_count = a->count;
end:
    if (s->part_count > 0)
        qsort(s->parts, s->part_count, sizeof *s->parts, by_point);
    return status;
}

/* ---- this rank's arrays ---- */

static void add_span(struct adding *a, bool is_new, size_t index)
{
    a->spans[a->span_count++] = (struct span){is_new, index};
}

/* Lists the rank's spans. Its new points are those of the cells that end after its first point and up to its end. */
static int list_spans(struct adding *a, struct kiln_error *error)
{
    const struct kiln_surface *s = a->s;
    const int status =
        kiln_arena_allocate(&a->arena, &a->spans, s->tile_run_count + a->group_count, sizeof *a->spans, WHAT, error);
    size_t g = 0;
    while (g < a->group_count && a->groups[g].end <= s->first.at)
        g++;
    for (size_t i = 0; i < s->tile_run_count && status == KILN_OK; i++) {
        for (; g < a->group_count && a->groups[g].end <= s->tile_runs[i].first.at; g++)
            add_span(a, true, g);
        add_span(a, false, i);
    }
    for (; status == KILN_OK && g < a->group_count && a->groups[g].end <= s->first.at + s->count; g++)
        add_span(a, true, g);
    return status;
}

/* The divided texel with this point, given by its new number; NULL: the texel is whole. */
static const struct kiln_subtexel_set *texel_of(const struct adding *a, uint64_t point)
{
    const struct kiln_subtexel_set key = {.divided = {.part = {{point}}}};
    return bsearch(&key, a->texels, a->count, sizeof *a->texels, by_texel);
}

/* The pieces of a part of a texel; `was`: old number of the texel's point. */
static const struct kiln_subtexel_piece *pieces_of(const struct adding *a, uint64_t was, uint32_t part, size_t *count)
{
    size_t low = 0, high = a->piece_count;
    const struct kiln_subtexel_piece key = {.point = was, .part = part};
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (by_piece(&a->pieces[middle], &key) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    for (*count = 0;
         low + *count < a->piece_count && a->pieces[low + *count].point == was && a->pieces[low + *count].part == part;
         ++*count)
        ;
    return a->pieces + low;
}

/* The rank's arrays while they are rebuilt. */
struct own {
    struct kiln_tile_run *tile_runs;
    uint64_t *piece_base, *area_cdf_base;
    uint16_t *piece_count, *albedo, *visible;
    uint32_t *pieces;
    float *area_cdf, *area;
    uint64_t point, piece, cdf; /* how many there are */
    uint64_t most_pieces, most_cdf;
};

static void own_destroy(struct own *o)
{
    kiln_free(&o->tile_runs);
    kiln_free(&o->piece_base);
    kiln_free(&o->area_cdf_base);
    kiln_free(&o->piece_count);
    kiln_free(&o->albedo);
    kiln_free(&o->visible);
    kiln_free(&o->pieces);
    kiln_free(&o->area_cdf);
    kiln_free(&o->area);
}

static int own_create(struct own *o, const struct adding *a, struct kiln_error *error)
{
    const struct kiln_surface *s = a->s;
    uint64_t points = s->count;
    for (size_t i = 0; i < a->span_count; i++)
        points += a->spans[i].is_new ? a->groups[a->spans[i].index].count : 0;
    o->most_pieces = s->piece_base[s->tile_run_count] + a->piece_count;
    o->most_cdf = s->area_cdf_base[s->tile_run_count] + a->piece_count;
    int status;
    KILN_TRY(kiln_allocate(&o->tile_runs, a->span_count, sizeof *o->tile_runs, "the tile runs", error));
    KILN_TRY(kiln_allocate(&o->piece_base, a->span_count + 1, sizeof *o->piece_base, "the tile runs", error));
    KILN_TRY(kiln_allocate(&o->area_cdf_base, a->span_count + 1, sizeof *o->area_cdf_base, "the tile runs", error));
    KILN_TRY(kiln_allocate(&o->piece_count, points, sizeof *o->piece_count, "the surface points", error));
    KILN_TRY(kiln_allocate(&o->albedo, 3 * points, sizeof *o->albedo, "the surface points", error));
    KILN_TRY(kiln_allocate(&o->visible, points, sizeof *o->visible, "the surface points", error));
    KILN_TRY(kiln_allocate(&o->pieces, o->most_pieces, sizeof *o->pieces, "the pieces", error));
    KILN_TRY(kiln_allocate(&o->area_cdf, o->most_cdf, sizeof *o->area_cdf, "the pieces", error));
    KILN_TRY(kiln_allocate(&o->area, points, sizeof *o->area, "the surface points", error));
end:
    return status;
}

/* Appends the pieces of a part. `whole`: flag in the point's piece count. */
static void add_part_pieces(struct own *o, const struct kiln_subtexel_piece *pieces, size_t count, uint16_t whole)
{
    double total = 0.0, sum = 0.0;
    for (size_t i = 0; i < count; i++)
        total += pieces[i].area;
    for (size_t i = 0; i < count; i++) {
        o->pieces[o->piece++] = pieces[i].triangle;
        sum += pieces[i].area;
        if (i + 1 < count)
            o->area_cdf[o->cdf++] = (float)fmin(sum / total, 1.0);
    }
    o->piece_count[o->point] = (uint16_t)((uint16_t)count | whole);
}

static void add_new(struct own *o, const struct adding *a, const uint64_t *was, const struct group *group)
{
    for (size_t i = group->first; i < group->first + group->count; i++) {
        const struct kiln_subtexel_set *t = &a->texels[a->extras[i].texel];
        size_t count;
        const struct kiln_subtexel_piece *pieces = pieces_of(a, was[a->extras[i].texel], a->extras[i].part, &count);
        add_part_pieces(o, pieces, count, 0);
        memcpy(o->albedo + 3 * o->point, t->albedo, sizeof t->albedo);
        o->area[o->point] = fmaxf(t->area[a->extras[i].part], 0x1p-126f);
        o->visible[o->point++] = 0xffff;
    }
}

/* Appends an old point, whose pieces and area fractions begin at `piece` and `cdf`. The point of a divided texel
 * becomes its part 0. */
static void add_old(struct own *o, const struct adding *a, const uint64_t *was, uint64_t old, uint64_t piece,
                    uint64_t cdf, uint64_t global)
{
    const struct kiln_surface *s = a->s;
    const uint32_t count = s->piece_count[old] & KILN_PIECES_MOST;
    const struct kiln_subtexel_set *t = texel_of(a, global);
    memcpy(o->albedo + 3 * o->point, s->albedo + 3 * old, 3 * sizeof *s->albedo);
    o->area[o->point] = s->area[old];
    o->visible[o->point] = s->visible[old];
    if (t == NULL) {
        memcpy(o->pieces + o->piece, s->pieces + piece, count * sizeof *s->pieces);
        memcpy(o->area_cdf + o->cdf, s->area_cdf + cdf, (count - 1) * sizeof *s->area_cdf);
        o->piece += count;
        o->cdf += count - 1;
        o->piece_count[o->point++] = s->piece_count[old];
        return;
    }
    size_t part_pieces;
    const struct kiln_subtexel_piece *pieces = pieces_of(a, was[t - a->texels], 0, &part_pieces);
    add_part_pieces(o, pieces, part_pieces, part_pieces == 1 ? s->piece_count[old] & KILN_PIECES_WHOLE : 0);
    for (uint32_t k = 1; k < t->count; k++)
        o->area[o->point] -= t->area[k];
    o->area[o->point] = fmaxf(o->area[o->point], 0x1p-126f);
    o->point++;
}

static void add_run(struct own *o, const struct adding *a, const uint64_t *was, size_t run, uint64_t first)
{
    const struct kiln_surface *s = a->s;
    const uint64_t old = s->tile_runs[run].first.at - s->first.at;
    uint64_t piece = s->piece_base[run], cdf = s->area_cdf_base[run];
    for (uint32_t k = 0; k < s->tile_runs[run].count; k++) {
        const uint32_t count = s->piece_count[old + k] & KILN_PIECES_MOST;
        add_old(o, a, was, old + k, piece, cdf, first + k);
        piece += count;
        cdf += count - 1;
    }
}

static void fill_own(struct own *o, const struct adding *a, const uint64_t *was)
{
    for (size_t i = 0; i < a->span_count; i++) {
        const struct span *span = &a->spans[i];
        o->piece_base[i] = o->piece;
        o->area_cdf_base[i] = o->cdf;
        o->tile_runs[i] = span->is_new ? a->groups[span->index].run : a->s->tile_runs[span->index];
        if (span->is_new) {
            add_new(o, a, was, &a->groups[span->index]);
            continue;
        }
        o->tile_runs[i].first.at += extras_before(a, o->tile_runs[i].first.at);
        add_run(o, a, was, span->index, o->tile_runs[i].first.at);
    }
    o->piece_base[a->span_count] = o->piece;
    o->area_cdf_base[a->span_count] = o->cdf;
}

static void take_own(struct adding *a, struct own *o)
{
    struct kiln_surface *s = a->s;
    s->first.at += extras_before(a, s->first.at);
    const struct kiln_surface before = *s;
    s->count = o->point;
    s->tile_run_count = a->span_count;
    s->tile_runs = o->tile_runs, o->tile_runs = before.tile_runs;
    s->piece_base = o->piece_base, o->piece_base = before.piece_base;
    s->area_cdf_base = o->area_cdf_base, o->area_cdf_base = before.area_cdf_base;
    s->piece_count = o->piece_count, o->piece_count = before.piece_count;
    s->albedo = o->albedo, o->albedo = before.albedo;
    s->visible = o->visible, o->visible = before.visible;
    s->pieces = o->pieces, o->pieces = before.pieces;
    s->area_cdf = o->area_cdf, o->area_cdf = before.area_cdf;
    s->area = o->area, o->area = before.area;
}

/* Rebuilds the rank's arrays. `was`: old numbers of the texels' points. */
static int make_own(struct adding *a, const uint64_t *was, struct kiln_error *error)
{
    struct own o = {0};
    int status;
    KILN_TRY(list_spans(a, error));
    KILN_TRY(own_create(&o, a, error));
    fill_own(&o, a, was);
    take_own(a, &o);
end:
    own_destroy(&o);
    return status;
}

/* ---- all of it ---- */

static int add(struct adding *a, struct kiln_error *error)
{
    const uint64_t tiles = a->s->tile_count;
    uint64_t *was = NULL;
    int status;
    KILN_TRY(kiln_allocate(&was, a->count, sizeof *was, WHAT, error));
    for (size_t i = 0; i < a->count; i++)
        was[i] = a->texels[i].divided.part[0].at;
    KILN_TRY(list_extras(a, error));
    KILN_TRY(group_extras(a, error));
    KILN_TRY(add_lightmaps(a, error));
    KILN_TRY(add_tiles(a, tiles, error));
    number_anew(a, tiles);
    KILN_TRY(make_own(a, was, error));
    number_cells_anew(a);
    KILN_TRY(enter_all(a, error));
    KILN_TRY(list_parts(a, error));
end:
    kiln_free(&was);
    return status;
}

int kiln_surface_add_subtexels(struct kiln_surface *surface, struct kiln_subtexel_set *texels, size_t count,
                               struct kiln_subtexel_piece *pieces, size_t piece_count, struct kiln_error *error)
{
    struct adding a = {.s = surface,
                       .texels = texels,
                       .count = count,
                       .pieces = pieces,
                       .piece_count = piece_count,
                       .point_count = surface->point_count};
    if (count == 0)
        return KILN_OK;
    qsort(texels, count, sizeof *texels, by_texel);
    qsort(pieces, piece_count, sizeof *pieces, by_piece);
    const int status = add(&a, error);
    kiln_arena_release(&a.arena);
    return status;
}
