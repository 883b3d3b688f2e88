#include "coordinator/layout/pack.h"

#include <stdlib.h>
#include <string.h>

#include "coordinator/layout/raster.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Packing of charts. The grid of cells (texels, or finer) is a bitmap of occupied cells: those that placed charts
 * touch, and their padding. A chart is rasterised, in up to four orientations, to a mask of the cells it touches. The
 * mask is moved over the grid row by row from below; in each row, all x positions are tested at once with shifted
 * words. Large charts are searched in a coarser copy of the grid (struct level). With many charts, a search begins
 * where the last one of similar size ended. pack_largest varies the density around this, and pack_free the width. */
enum {
    BORDER = 1,
    MANY_CHARTS = 256,  /* from this number of charts on, a search starts where the last one of similar size ended */
    TURN_CHARTS = 2000, /* from this number of charts on, only two of the four orientations are tried */
    CLASSES = 64,
    LEVELS = 12,
    CANDIDATES_MAX = 10,
    TRIES_TRIANGLES = 2000000 /* triangles rasterised, at most, over all widths tried */
};
static const double SNAP = 0.125;           /* largest stretch that may put a rectangle's sides on texel borders */
static const double TOUCH_TOLERANCE = 1e-3; /* in cells; a chart's own rounding is below 1e-9 */

/* A chart's bounding box in cells, and the scale from its metres to cells. */
struct box {
    uint32_t chart;
    uint32_t width, height;
    double scale[2], inset[2];
};

struct run {
    uint32_t row, first, end;
};

/* The grid reduced to blocks of 1 << index cells: a block is set if any of its cells is. Index 0 is the grid itself.
 * Rows of cells first .. end-1 have changed since this level was last brought up to date. */
struct level {
    struct kiln_bitmap blocks; /* unused at index 0 */
    uint32_t *longest_free;    /* per row: its longest run of free blocks */
    size_t longest_capacity;
    uint32_t changed_first, changed_end;
};

struct packer {
    const struct kiln_charts *charts;
    const struct kiln_topology *topology;
    uint32_t padding;
    struct box *boxes; /* largest first */
    double (*maps)[6]; /* in cells of the whole grid, border included */
    /* The current attempt. `fine` has a bit per cell, set where no chart may be. */
    uint32_t inner_width, height_limit;
    uint32_t used_width, used_height;
    struct kiln_bitmap fine;
    struct level levels[LEVELS];
    uint32_t cursor[CLASSES][CLASSES]; /* cells */
    /* The current chart. */
    struct kiln_bitmap upright, mask, coarse_mask;
    struct run *runs;
    size_t run_count, run_capacity;
    uint64_t *line, *blocked;
    size_t line_capacity, blocked_capacity;
    struct kiln_arena arena;
};

static struct box chart_box(const struct kiln_chart *chart, uint32_t index, double density)
{
    struct box box = {.chart = index};
    const double size[2] = {chart->width * density, chart->height * density};
    double side[2] = {fmax(round(size[0]), 1.0), fmax(round(size[1]), 1.0)};
    const bool snap =
        chart->rectangular && fabs(side[0] - size[0]) <= SNAP * size[0] && fabs(side[1] - size[1]) <= SNAP * size[1];
    for (int k = 0; k < 2; k++) {
        if (!snap)
            side[k] = fmax(ceil(size[k] - 1e-6), 1.0);
        box.scale[k] = snap ? density * (side[k] / size[k]) : density;
        box.inset[k] = snap ? 0.0 : 0.5 * (side[k] - size[k]);
    }
    box.width = (uint32_t)side[0];
    box.height = (uint32_t)side[1];
    return box;
}

static int compare_boxes(const void *a, const void *b)
{
    const struct box *p = a, *q = b;
    const uint32_t p_long = p->width > p->height ? p->width : p->height,
                   q_long = q->width > q->height ? q->width : q->height;
    if (p_long != q_long)
        return p_long > q_long ? -1 : 1;
    const uint64_t p_area = (uint64_t)p->width * p->height, q_area = (uint64_t)q->width * q->height;
    if (p_area != q_area)
        return p_area > q_area ? -1 : 1;
    return p->chart < q->chart ? -1 : p->chart > q->chart;
}

/* The map from a chart's metres to cells of its own box, rotated by `turns` quarter turns. */
static void box_map(const struct box *box, int turns, double m[6])
{
    const double w = box->width, h = box->height, sx = box->scale[0], sy = box->scale[1], ix = box->inset[0],
                 iy = box->inset[1];
    const double maps[4][6] = {{sx, 0.0, ix, 0.0, sy, iy},
                               {0.0, -sy, h - iy, sx, 0.0, ix},
                               {-sx, 0.0, w - ix, 0.0, -sy, h - iy},
                               {0.0, sy, iy, -sx, 0.0, w - ix}};
    memcpy(m, maps[turns], sizeof maps[0]);
}

static void map_point(const double m[6], const double ab[2], double xy[2])
{
    xy[0] = m[0] * ab[0] + m[1] * ab[1] + m[2];
    xy[1] = m[3] * ab[0] + m[4] * ab[1] + m[5];
}

/* First cell at or after `from` whose bit is `value`, or `end`. */
static uint32_t next_bit(const uint64_t *row, uint32_t from, uint32_t end, bool value)
{
    while (from < end) {
        const uint64_t word = (value ? row[from / 64] : ~row[from / 64]) >> (from % 64);
        if (word != 0) {
            const uint32_t found = from + (uint32_t)__builtin_ctzll(word);
            return found < end ? found : end;
        }
        from = (from / 64 + 1) * 64;
    }
    return end;
}

/* Rasterises the chart, not rotated: the cells of its box that it touches. */
static int draw_upright(struct packer *p, const struct box *box, struct kiln_error *error)
{
    const struct kiln_chart *chart = &p->charts->charts[box->chart];
    const int status = kiln_bitmap_reset(&p->upright, box->width, box->height, error);
    if (status != KILN_OK)
        return status;
    if (chart->rectangular || (box->width <= 2 && box->height <= 2)) {
        for (uint32_t y = 0; y < box->height; y++)
            kiln_bitmap_set_run(&p->upright, y, 0, box->width);
        return KILN_OK;
    }
    double m[6];
    box_map(box, 0, m);
    for (size_t i = 0; i < chart->count; i++) {
        const uint32_t *c = p->topology->triangles + 3 * (size_t)p->charts->order[chart->first + i];
        double corner[3][2];
        for (int k = 0; k < 3; k++) {
            double ab[2];
            kiln_chart_project(chart, p->topology->points[c[k]], ab);
            map_point(m, ab, corner[k]);
        }
        kiln_raster_touch(&p->upright, (const double(*)[2])corner, TOUCH_TOLERANCE);
    }
    return KILN_OK;
}

/* The upright mask, rotated as box_map rotates positions. */
static int turn_mask(struct packer *p, int turns, struct kiln_error *error)
{
    const struct kiln_bitmap *from = &p->upright;
    const uint32_t w = from->width, h = from->height;
    const int status = kiln_bitmap_reset(&p->mask, turns % 2 == 0 ? w : h, turns % 2 == 0 ? h : w, error);
    if (status != KILN_OK)
        return status;
    if (turns == 0)
        memcpy(p->mask.words, from->words, from->stride * h * sizeof *from->words);
    for (uint32_t y = 0; y < h && turns != 0; y++) {
        const uint64_t *row = from->words + (size_t)y * from->stride;
        for (uint32_t x = next_bit(row, 0, w, true); x < w; x = next_bit(row, x + 1, w, true)) {
            const uint32_t tx = turns == 1 ? h - 1 - y : turns == 2 ? w - 1 - x : y;
            const uint32_t ty = turns == 1 ? x : turns == 2 ? h - 1 - y : w - 1 - x;
            p->mask.words[(size_t)ty * p->mask.stride + tx / 64] |= 1ull << (tx % 64);
        }
    }
    return KILN_OK;
}

static uint32_t longest_free_run(const uint64_t *row, uint32_t width)
{
    uint32_t longest = 0;
    for (uint32_t x = next_bit(row, 0, width, false); x < width;) {
        const uint32_t end = next_bit(row, x, width, true);
        longest = end - x > longest ? end - x : longest;
        x = next_bit(row, end, width, false);
    }
    return longest;
}

/* Row y of a bitmap reduced by `block`: a block is set if any of its cells is. */
static void shrink_row(const struct kiln_bitmap *from, struct kiln_bitmap *to, uint32_t y, uint32_t block)
{
    uint64_t *row = to->words + (size_t)y * to->stride;
    memset(row, 0, to->stride * sizeof *row);
    for (uint32_t line = y * block; line < (y + 1) * block && line < from->height; line++) {
        const uint64_t *source = from->words + (size_t)line * from->stride;
        for (uint32_t x = next_bit(source, 0, from->width, true); x < from->width;) {
            const uint32_t end = next_bit(source, x, from->width, false);
            const uint32_t last = (end - 1) / block + 1;
            kiln_bitmap_set_run(to, y, x / block, last < to->width ? last : to->width);
            x = next_bit(source, end, from->width, true);
        }
    }
}

static struct kiln_bitmap *level_grid(struct packer *p, uint32_t level)
{
    return level == 0 ? &p->fine : &p->levels[level].blocks;
}

/* Updates a level, and makes it at least `height` blocks high. */
static int refresh_level(struct packer *p, uint32_t level, uint32_t height, struct kiln_error *error)
{
    struct level *l = &p->levels[level];
    struct kiln_bitmap *grid = level_grid(p, level);
    const uint32_t old_height = p->fine.height;
    int status = kiln_bitmap_extend(&p->fine, height << level, error);
    if (status != KILN_OK)
        return status;
    for (uint32_t i = 0; i < LEVELS && p->fine.height > old_height; i++) {
        p->levels[i].changed_first = p->levels[i].changed_first < old_height ? p->levels[i].changed_first : old_height;
        p->levels[i].changed_end = p->fine.height;
    }
    const uint32_t first = l->changed_first >> level, end = (l->changed_end + (1u << level) - 1) >> level;
    KILN_TRY(kiln_bitmap_extend(grid, end > height ? end : height, error));
    KILN_TRY(kiln_grow(&l->longest_free, &l->longest_capacity, grid->height, sizeof *l->longest_free, "packing charts",
                       error));
    for (uint32_t y = first; y < end; y++) {
        if (level > 0)
            shrink_row(&p->fine, grid, y, 1u << level);
        l->longest_free[y] = longest_free_run(grid->words + (size_t)y * grid->stride, grid->width);
    }
end:
    l->changed_first = UINT32_MAX;
    l->changed_end = 0;
    return status;
}

static int reset_levels(struct packer *p, struct kiln_error *error)
{
    int status = kiln_bitmap_reset(&p->fine, p->inner_width, 0, error);
    for (uint32_t level = 0; level < LEVELS && status == KILN_OK; level++) {
        p->levels[level].changed_first = UINT32_MAX;
        p->levels[level].changed_end = 0;
        if (level > 0)
            status =
                kiln_bitmap_reset(&p->levels[level].blocks, (p->inner_width + (1u << level) - 1) >> level, 0, error);
    }
    memset(p->cursor, 0, sizeof p->cursor);
    return status;
}

/* The mask's rows as runs of blocks, beginning with the middle row, which is likely to be the longest. */
static int mask_runs(struct packer *p, uint32_t level, uint32_t *height, struct kiln_error *error)
{
    const struct kiln_bitmap *mask = &p->mask;
    const uint32_t block = 1u << level, width = (p->mask.width + block - 1) / block;
    *height = (p->mask.height + block - 1) / block;
    if (level > 0) {
        const int status = kiln_bitmap_reset(&p->coarse_mask, width, *height, error);
        if (status != KILN_OK)
            return status;
        for (uint32_t y = 0; y < *height; y++)
            shrink_row(&p->mask, &p->coarse_mask, y, block);
        mask = &p->coarse_mask;
    }
    p->run_count = 0;
    for (uint32_t i = 0; i < *height; i++) {
        const uint32_t y = (i + *height / 2) % *height;
        const uint64_t *row = mask->words + (size_t)y * mask->stride;
        for (uint32_t x = next_bit(row, 0, width, true); x < width;) {
            const uint32_t end = next_bit(row, x, width, false);
            const int status = kiln_arena_grow(&p->arena, &p->runs, &p->run_capacity, p->run_count + 1, sizeof *p->runs,
                                               "packing charts", error);
            if (status != KILN_OK)
                return status;
            p->runs[p->run_count++] = (struct run){y, x, end};
            x = next_bit(row, end, width, true);
        }
    }
    return KILN_OK;
}

/* to |= from >> shift, where `to` may be `from`. */
static void or_shifted(uint64_t *to, const uint64_t *from, size_t words, uint32_t shift)
{
    const size_t skip = shift / 64;
    const uint32_t bits = shift % 64;
    for (size_t i = 0; i + skip < words; i++) {
        uint64_t value = from[i + skip] >> bits;
        if (bits != 0 && i + skip + 1 < words)
            value |= from[i + skip + 1] << (64 - bits);
        to[i] |= value;
    }
}

/* Lowest x, below `positions`, at which the mask is free in the grid's rows from y on, or KILN_NONE. Bit x of `blocked`
 * is set if some run of the mask overlaps a set cell when the mask is at x. */
static uint32_t free_position(struct packer *p, uint32_t level, uint32_t y, uint32_t positions)
{
    const struct kiln_bitmap *grid = level_grid(p, level);
    const uint32_t *longest_free = p->levels[level].longest_free;
    for (size_t i = 0; i < p->run_count; i++)
        if (longest_free[y + p->runs[i].row] < p->runs[i].end - p->runs[i].first)
            return KILN_NONE;
    const size_t words = grid->stride;
    memset(p->blocked, 0, words * sizeof *p->blocked);
    for (size_t i = 0; i < p->run_count; i++) {
        const struct run run = p->runs[i];
        if (longest_free[y + run.row] == grid->width)
            continue;
        memcpy(p->line, grid->words + (size_t)(y + run.row) * words, words * sizeof *p->line);
        for (uint32_t length = 1, target = run.end - run.first; length < target;) {
            const uint32_t step = length < target - length ? length : target - length;
            or_shifted(p->line, p->line, words, step);
            length += step;
        }
        or_shifted(p->blocked, p->line, words, run.first);
        if (next_bit(p->blocked, 0, positions, false) == positions)
            return KILN_NONE;
    }
    const uint32_t x = next_bit(p->blocked, 0, positions, false);
    return x < positions ? x : KILN_NONE;
}

static uint32_t size_class(uint32_t size)
{
    const uint32_t c = (uint32_t)(4.0 * log2(size));
    return c < CLASSES ? c : CLASSES - 1;
}

struct position {
    uint32_t x, y, top; /* cells; top: first row above the mask */
    int turns;
};

/* Searches from below, in steps of a block, for the mask's first free position whose top is below best->top. */
static int search(struct packer *p, uint32_t level, int turns, struct position *best, struct kiln_error *error)
{
    uint32_t height;
    int status = mask_runs(p, level, &height, error);
    if (status == KILN_OK)
        status = refresh_level(p, level, height, error);
    if (status != KILN_OK || p->mask.width > p->inner_width)
        return status;
    const uint32_t positions = ((p->inner_width - p->mask.width) >> level) + 1;
    uint32_t *cursor = &p->cursor[size_class(p->mask.width)][size_class(p->mask.height)];
    for (uint32_t y = p->charts->count > MANY_CHARTS ? *cursor >> level : 0; (y << level) + p->mask.height < best->top;
         y++) {
        if (y + height > level_grid(p, level)->height) {
            status = refresh_level(p, level, y + height, error);
            if (status != KILN_OK)
                return status;
        }
        const uint32_t x = free_position(p, level, y, positions);
        if (x == KILN_NONE)
            continue;
        *cursor = y << level;
        *best = (struct position){x << level, y << level, (y << level) + p->mask.height, turns};
        break;
    }
    return KILN_OK;
}

/* Marks the mask and its padding as taken in the fine grid. */
static int stamp(struct packer *p, const struct position *at, struct kiln_error *error)
{
    const uint32_t top = at->y + p->mask.height + p->padding, bottom = at->y > p->padding ? at->y - p->padding : 0;
    const int status = refresh_level(p, 0, top, error);
    if (status != KILN_OK)
        return status;
    for (uint32_t row = 0; row < p->mask.height; row++) {
        const uint64_t *source = p->mask.words + (size_t)row * p->mask.stride;
        const uint32_t y = at->y + row, low = y > p->padding ? y - p->padding : 0;
        for (uint32_t x = next_bit(source, 0, p->mask.width, true); x < p->mask.width;) {
            const uint32_t end = next_bit(source, x, p->mask.width, false);
            const uint32_t left = at->x + x, right = at->x + end + p->padding;
            for (uint32_t line = low; line <= y + p->padding; line++)
                kiln_bitmap_set_run(&p->fine, line, left > p->padding ? left - p->padding : 0,
                                    right < p->inner_width ? right : p->inner_width);
            x = next_bit(source, end, p->mask.width, true);
        }
    }
    for (uint32_t level = 0; level < LEVELS; level++) {
        struct level *l = &p->levels[level];
        l->changed_first = l->changed_first < bottom ? l->changed_first : bottom;
        l->changed_end = l->changed_end > top ? l->changed_end : top;
    }
    return KILN_OK;
}

/* The level at which a chart is searched. Large charts are searched in steps of a block: less work, at the loss of a
 * small fraction of the chart's narrower side. */
static uint32_t box_level(const struct packer *p, const struct box *box)
{
    const size_t count = p->charts->count;
    const uint32_t blocks = count < 100 ? 128 : count < 500 ? 64 : 32;
    const uint32_t side = box->width > box->height ? box->width : box->height,
                   narrow = box->width < box->height ? box->width : box->height;
    uint32_t level = 0;
    while (level + 1 < LEVELS && blocks << level < side && 16u << level < narrow)
        level++;
    return level;
}

static int place(struct packer *p, const struct box *box, bool *fits, struct kiln_error *error)
{
    const bool rectangular = p->charts->charts[box->chart].rectangular, tiny = box->width <= 2 && box->height <= 2;
    int turns_end = p->charts->count < TURN_CHARTS ? 4 : 2;
    if (rectangular || tiny)
        turns_end = box->width == box->height ? 1 : 2;
    struct position best = {.top = p->height_limit + 1};
    const struct position none = best;
    int status = draw_upright(p, box, error), drawn = -1;
    for (int turns = 0; turns < turns_end && status == KILN_OK; turns++) {
        status = turn_mask(p, turns, error);
        drawn = turns;
        if (status == KILN_OK)
            status = search(p, box_level(p, box), turns, &best, error);
    }
    if (status != KILN_OK)
        return status;
    *fits = best.top != none.top;
    if (!*fits)
        return KILN_OK;
    if (drawn != best.turns)
        status = turn_mask(p, best.turns, error);
    if (status == KILN_OK)
        status = stamp(p, &best, error);
    double *m = p->maps[box->chart];
    box_map(box, best.turns, m);
    m[2] += best.x + BORDER;
    m[5] += best.y + BORDER;
    p->used_width = best.x + p->mask.width > p->used_width ? best.x + p->mask.width : p->used_width;
    p->used_height = best.top > p->used_height ? best.top : p->used_height;
    return status;
}

/* Attempts to pack all charts at `density` cells a metre into a grid of `width` x at most `height` cells, including the
 * border. */
static int attempt(struct packer *p, double density, uint32_t width, uint32_t height, bool *fits,
                   struct kiln_error *error)
{
    *fits = false;
    if (width <= 2 * BORDER || height <= 2 * BORDER)
        return KILN_OK;
    p->inner_width = width - 2 * BORDER;
    p->height_limit = height - 2 * BORDER;
    p->used_width = p->used_height = 0;
    for (size_t i = 0; i < p->charts->count; i++) {
        const struct kiln_chart *chart = &p->charts->charts[i];
        const double longer = fmax(chart->width, chart->height) * density,
                     limit = fmax(p->inner_width, p->height_limit);
        if (longer > limit + 1.0)
            return KILN_OK;
        p->boxes[i] = chart_box(chart, (uint32_t)i, density);
    }
    qsort(p->boxes, p->charts->count, sizeof *p->boxes, compare_boxes);
    int status;
    KILN_TRY(reset_levels(p, error));
    KILN_TRY(kiln_arena_grow(&p->arena, &p->line, &p->line_capacity, p->fine.stride, sizeof *p->line, "packing charts",
                             error));
    KILN_TRY(kiln_arena_grow(&p->arena, &p->blocked, &p->blocked_capacity, p->fine.stride, sizeof *p->blocked,
                             "packing charts", error));
end:
    *fits = true;
    for (size_t i = 0; i < p->charts->count && *fits && status == KILN_OK; i++)
        status = place(p, &p->boxes[i], fits, error);
    p->used_width += 2 * BORDER;
    p->used_height += 2 * BORDER;
    return status;
}

/* Estimates, from the charts' areas, the cells that they need with their padding. */
static double needed_cells(const struct packer *p, double density)
{
    double cells = 0.0;
    for (size_t i = 0; i < p->charts->count; i++) {
        const struct kiln_chart *c = &p->charts->charts[i];
        const double w = c->width * density, h = c->height * density;
        cells += c->area * density * density + (0.5 + p->padding) * (w + h) + (1.0 + p->padding) * (1.0 + p->padding);
    }
    return cells;
}

/* Lists widths to try for a lightmap of free proportions. */
static size_t candidate_widths(const struct packer *p, double density, uint32_t limit, uint32_t widths[CANDIDATES_MAX])
{
    double longest = 1.0;
    for (size_t i = 0; i < p->charts->count; i++)
        longest = fmax(longest, ceil(fmax(p->charts->charts[i].width, p->charts->charts[i].height) * density));
    const double side = sqrt(needed_cells(p, density)), least = fmin(longest + 2.0 * BORDER, limit);
    static const double factors[CANDIDATES_MAX] = {1.05, 0.9, 1.2, 0.97, 1.12, 0.8, 1.35, 1.5, 0.7, 1.7};
    const size_t count = p->charts->count, affordable = TRIES_TRIANGLES / (p->topology->triangle_count + 1) + 1;
    const size_t wanted = count <= 64 ? CANDIDATES_MAX : count <= 500 ? 5 : count <= 2000 ? 3 : 1;
    const size_t tries = wanted < affordable ? wanted : affordable;
    size_t found = 0;
    for (size_t i = 0; i < tries; i++) {
        const double width = fmin(fmax(ceil(side * factors[i]) + 2.0 * BORDER, least), limit);
        bool known = false;
        for (size_t k = 0; k < found; k++)
            known = known || widths[k] == (uint32_t)width;
        if (!known)
            widths[found++] = (uint32_t)width;
    }
    return found;
}

struct best {
    double (*maps)[6]; /* to 0..1 */
    uint32_t width, height;
    double density;
};

static void keep(const struct packer *p, struct best *best, uint32_t width, uint32_t height, double density)
{
    for (size_t i = 0; i < p->charts->count; i++)
        for (int k = 0; k < 6; k++)
            best->maps[i][k] = p->maps[i][k] / (k < 3 ? width : height);
    best->width = width;
    best->height = height;
    best->density = density;
}

/* The smallest of a few lightmaps at the wanted density. *fits is false if all are larger than the limit. */
static int pack_free(struct packer *p, struct best *best, const struct kiln_pack_params *params, bool *fits,
                     struct kiln_error *error)
{
    uint32_t widths[CANDIDATES_MAX];
    const double density = params->texels_per_metre;
    *fits = false;
    if (!(needed_cells(p, density) < 2.0 * params->limit * (double)params->limit))
        return KILN_OK;
    const size_t count = candidate_widths(p, density, params->limit, widths);
    for (size_t i = 0; i < count; i++) {
        bool fit;
        const int status = attempt(p, density, widths[i], params->limit, &fit, error);
        if (status != KILN_OK)
            return status;
        const uint64_t texels = (uint64_t)p->used_width * p->used_height;
        if (fit && (!*fits || texels < (uint64_t)best->width * best->height))
            keep(p, best, p->used_width, p->used_height, density);
        *fits = *fits || fit;
    }
    return KILN_OK;
}

/* The highest density, at most `ceiling`, at which all charts fit a grid of side x side: found by steps, then by
 * bisection of the last step. */
static int pack_largest(struct packer *p, struct best *best, const struct kiln_pack_params *params, uint32_t cells,
                        bool *fits, struct kiln_error *error)
{
    const uint32_t side = params->limit * cells;
    const double ceiling = params->texels_per_metre * cells, shrink = p->charts->count > TURN_CHARTS ? 0.8 : 0.93;
    double low = 0.0, high = ceiling > 0.0 ? ceiling : INFINITY, area = 0.0;
    for (size_t i = 0; i < p->charts->count; i++)
        area += p->charts->charts[i].area;
    double density = fmin(high, side / sqrt(area));
    while (density > 1e-3 * side / sqrt(area) && needed_cells(p, density) > 0.95 * side * (double)side)
        density *= 0.95;
    const double least = 1e-3 * density;
    int refinements = p->charts->count > TURN_CHARTS ? 1 : 4;
    *fits = false;
    for (;;) {
        bool fit;
        const int status = attempt(p, density, side, side, &fit, error);
        if (status != KILN_OK)
            return status;
        if (fit) {
            if (params->exact)
                keep(p, best, side, side, density);
            else
                keep(p, best, (p->used_width + cells - 1) / cells * cells, (p->used_height + cells - 1) / cells * cells,
                     density);
            *fits = true;
            low = density;
            if (density >= ceiling && ceiling > 0.0)
                return KILN_OK;
        } else {
            high = density;
        }
        if (!*fits)
            density *= density < 0.1 * side / sqrt(area) ? 0.5 : shrink;
        else if (!isfinite(high) || high >= 1.2 * low)
            density = fmin(low * 1.1, high);
        else if (refinements-- > 0)
            density = sqrt(low * high);
        else
            return KILN_OK;
        if (density < least)
            return KILN_OK;
    }
}

static int pack_into(struct packer *p, struct best *best, const struct kiln_pack_params *params, uint32_t *cells,
                     struct kiln_error *error)
{
    bool fits = false;
    int status = KILN_OK;
    *cells = 1;
    if (!params->exact)
        status = pack_free(p, best, params, &fits, error);
    const double room = (1.0 + p->padding) * (1.0 + p->padding) * (double)p->charts->count;
    while (status == KILN_OK && !fits) {
        const uint64_t side = (uint64_t)params->limit * *cells;
        if (side > 1u << 20)
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%zu charts do not fit a lightmap of %u x %u; allow a larger one or split the mesh",
                             p->charts->count, params->limit, params->limit);
        if (room < (double)side * (double)side)
            status = pack_largest(p, best, params, *cells, &fits, error);
        if (fits) {
            best->width /= *cells;
            best->height /= *cells;
            best->density /= *cells;
        } else {
            *cells *= 2;
        }
    }
    return status;
}

int kiln_pack(struct kiln_packing *packing, const struct kiln_charts *charts, const struct kiln_topology *topology,
              const struct kiln_pack_params *params, struct kiln_error *error)
{
    struct packer p = {.charts = charts, .topology = topology, .padding = params->padding};
    struct best best = {0};
    uint32_t cells = 1;
    int status = kiln_arena_allocate(&p.arena, &p.boxes, charts->count, sizeof *p.boxes, "packing charts", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&p.arena, &p.maps, charts->count, sizeof *p.maps, "packing charts", error);
    if (status == KILN_OK)
        status = kiln_allocate(&best.maps, charts->count, sizeof *best.maps, "packing charts", error);
    if (status == KILN_OK)
        status = pack_into(&p, &best, params, &cells, error);
    kiln_free(&p.coarse_mask.words);
    kiln_free(&p.mask.words);
    kiln_free(&p.upright.words);
    for (size_t i = 0; i < LEVELS; i++) {
        kiln_free(&p.levels[i].longest_free);
        kiln_free(&p.levels[i].blocks.words);
    }
    kiln_free(&p.fine.words);
    kiln_arena_release(&p.arena);
    if (status != KILN_OK)
        kiln_free(&best.maps);
    *packing = (struct kiln_packing){best.width, best.height, best.density, cells, best.maps};
    return status;
}
