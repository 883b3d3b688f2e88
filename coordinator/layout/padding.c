#include "coordinator/layout/padding.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/layout/topology.h"
#include "worker/base/arena.h"
#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"

enum { CELLS_MAX = 1 << 22, CELL_ENTRIES = 8, RINGS_MAX = 16, ENTRIES_MAX = 1 << 26 };
/* distance between samples of a border, texels; larger if there would be too many samples */
static const double STEP = 0.5;
static const double SAMPLES_MAX = 1 << 23;
static const double TOLERANCE = 1.0 / 64.0; /* texels: packers put charts two texels apart, up to rounding */

/* ---- charts ---- */

struct key {
    uint32_t words[5];
};

/* adding 0 turns -0 into 0, so that both have the same bits */
static struct key key_of(const struct kiln_vec3 *positions, const struct kiln_vec2 *uv, uint32_t v)
{
    const float values[5] = {positions[v].x + 0.0f, positions[v].y + 0.0f, positions[v].z + 0.0f, uv[v].x + 0.0f,
                             uv[v].y + 0.0f};
    struct key key;
    memcpy(key.words, values, sizeof key.words);
    return key;
}

/* Joins equal vertices: first[v] is the first one with v's position and coordinate. */
static int join_vertices(uint32_t *first, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv, size_t count,
                         struct kiln_error *error)
{
    const size_t slots = kiln_layout_table_size(count);
    uint32_t *table = NULL; /* vertex + 1 */
    const int status = kiln_allocate(&table, slots, sizeof *table, "the charts of a layout", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t v = 0; v < count; v++) {
        const struct key key = key_of(positions, uv, v);
        uint64_t hash = 0;
        for (int i = 0; i < 5; i++)
            hash = kiln_layout_mix(hash ^ key.words[i]);
        size_t slot = hash & (slots - 1);
        for (; table[slot] != 0; slot = (slot + 1) & (slots - 1)) {
            const struct key other = key_of(positions, uv, table[slot] - 1);
            if (memcmp(&key, &other, sizeof key) == 0)
                break;
        }
        if (table[slot] == 0)
            table[slot] = v + 1;
        first[v] = table[slot] - 1;
    }
    kiln_free(&table);
    return KILN_OK;
}

/* A hash table of edges. An entry is the first triangle of an edge and its corner, + 1; 0: free. */
struct edge_table {
    uint32_t *entries;
    size_t slots;
};

static void edge_ends(const uint32_t *first, const uint32_t *triangles, uint32_t edge, uint32_t *low, uint32_t *high)
{
    const uint32_t t = edge / 3, k = edge % 3, a = first[triangles[3 * t + k]],
                   b = first[triangles[3 * t + (k + 1) % 3]];
    *low = a < b ? a : b;
    *high = a < b ? b : a;
}

/* Joins the triangle to the first one with the same edge, if there is one. */
static void join_edge(struct edge_table *table, const uint32_t *first, const uint32_t *triangles, uint32_t edge,
                      uint32_t *parent, uint8_t *borders)
{
    uint32_t low, high;
    edge_ends(first, triangles, edge, &low, &high);
    size_t slot = kiln_layout_mix((uint64_t)low << 32 | high) & (table->slots - 1);
    for (; table->entries[slot] != 0; slot = (slot + 1) & (table->slots - 1)) {
        const uint32_t other = table->entries[slot] - 1;
        uint32_t other_low, other_high;
        edge_ends(first, triangles, other, &other_low, &other_high);
        if (other_low != low || other_high != high)
            continue;
        kiln_sets_join(parent, edge / 3, other / 3);
        borders[edge / 3] &= (uint8_t) ~(1u << edge % 3);
        borders[other / 3] &= (uint8_t) ~(1u << other % 3);
        return;
    }
    table->entries[slot] = edge + 1;
}

static int join_triangles(const uint32_t *first, const uint32_t *triangles, size_t triangle_count, uint32_t *parent,
                          uint8_t *borders, struct kiln_error *error)
{
    struct edge_table table = {.slots = kiln_layout_table_size(3 * triangle_count)};
    const int status =
        kiln_allocate(&table.entries, table.slots, sizeof *table.entries, "the charts of a layout", error);
    for (uint32_t t = 0; t < triangle_count && status == KILN_OK; t++) {
        parent[t] = t;
        borders[t] = 7;
    }
    for (uint32_t e = 0; e < 3 * triangle_count && status == KILN_OK; e++)
        join_edge(&table, first, triangles, e, parent, borders);
    kiln_free(&table.entries);
    return status;
}

int kiln_padding_charts(const struct kiln_vec3 *positions, const struct kiln_vec2 *uv, size_t vertex_count,
                        const uint32_t *triangles, size_t triangle_count, uint32_t *chart, uint8_t *borders,
                        size_t *chart_count, struct kiln_error *error)
{
    uint32_t *first = NULL, *parent = NULL;
    *chart_count = 0;
    int status;
    KILN_TRY(kiln_allocate(&first, vertex_count, sizeof *first, "the charts of a layout", error));
    KILN_TRY(kiln_allocate(&parent, triangle_count, sizeof *parent, "the charts of a layout", error));
    KILN_TRY(join_vertices(first, positions, uv, vertex_count, error));
    KILN_TRY(join_triangles(first, triangles, triangle_count, parent, borders, error));
    for (uint32_t t = 0; t < triangle_count; t++) {
        /* the least of its set, so it is numbered already unless it is t */
        const uint32_t root = kiln_sets_root(parent, t);
        chart[t] = root == t ? (uint32_t)(*chart_count)++ : chart[root];
    }
end:
    kiln_free(&first);
    kiln_free(&parent);
    return status;
}

/* ---- distances ---- */

struct segment {
    double from[2], to[2]; /* texels */
    uint32_t chart;
};

struct grid {
    struct segment *segments;
    size_t segment_count;
    double cell; /* texels a side */
    uint32_t across, down, rings;
    size_t *first;     /* the entries of cell c are first[c + 1] .. first[c + 2] - 1 */
    uint32_t *entries; /* segments */
    struct kiln_arena arena;
};

static uint32_t cell_at(double x, double cell, uint32_t count)
{
    const double i = floor(x / cell);
    return i <= 0.0 ? 0 : i >= (double)count ? count - 1 : (uint32_t)i;
}

/* The columns of cells that the segment touches within row y; of the whole segment where it lies along the row. */
static void columns_in_row(const struct grid *g, const struct segment *s, uint32_t y, uint32_t *low, uint32_t *high)
{
    double t[2] = {0.0, 1.0};
    const double dy = s->to[1] - s->from[1], bottom = y * g->cell, top = bottom + g->cell;
    if (fabs(dy) > 1e-9) {
        const double a = (bottom - s->from[1]) / dy, b = (top - s->from[1]) / dy;
        t[0] = fmin(fmax(fmin(a, b), 0.0), 1.0);
        t[1] = fmin(fmax(fmax(a, b), 0.0), 1.0);
    }
    const double x0 = s->from[0] + t[0] * (s->to[0] - s->from[0]), x1 = s->from[0] + t[1] * (s->to[0] - s->from[0]);
    *low = cell_at(fmin(x0, x1), g->cell, g->across);
    *high = cell_at(fmax(x0, x1), g->cell, g->across);
}

/* Counts the segment in each cell it touches or, if not `count`, enters it there. */
static void enter(struct grid *g, uint32_t index, bool count)
{
    const struct segment *s = &g->segments[index];
    const uint32_t last = cell_at(fmax(s->from[1], s->to[1]), g->cell, g->down);
    for (uint32_t y = cell_at(fmin(s->from[1], s->to[1]), g->cell, g->down); y <= last; y++) {
        uint32_t low, high;
        columns_in_row(g, s, y, &low, &high);
        for (uint32_t x = low; x <= high; x++) {
            const size_t cell = (size_t)y * g->across + x;
            if (count)
                g->first[cell + 1]++;
            else
                /* cells are filled from their end to their beginning */
                g->entries[--g->first[cell + 1]] = index;
        }
    }
}

static void choose_cell(struct grid *g, double cell, double width, double height)
{
    g->cell = cell;
    g->rings = cell >= KILN_PADDING_TEXELS ? 1 : (uint32_t)ceil(KILN_PADDING_TEXELS / cell);
    g->across = (uint32_t)fmax(1.0, ceil(width / cell));
    g->down = (uint32_t)fmax(1.0, ceil(height / cell));
}

/* Chooses cells of two texels, or smaller ones if cells would have many segments. */
static void size_grid(struct grid *g, double width, double height)
{
    double cell = KILN_PADDING_TEXELS;
    while ((double)g->segment_count > CELL_ENTRIES * width * height / (cell * cell) &&
           cell > KILN_PADDING_TEXELS / RINGS_MAX)
        cell *= 0.5;
    while (ceil(width / cell) * ceil(height / cell) > CELLS_MAX)
        cell *= 2.0;
    choose_cell(g, cell, width, height);
}

/* Counts the entries before each cell into first[cell + 2]. */
static int count_entries(struct grid *g, struct kiln_error *error)
{
    const size_t cells = (size_t)g->across * g->down;
    kiln_arena_free(&g->arena, &g->first);
    const int status =
        kiln_arena_allocate(&g->arena, &g->first, cells + 2, sizeof *g->first, "borders of charts", error);
    for (uint32_t i = 0; i < g->segment_count && status == KILN_OK; i++)
        enter(g, i, true);
    for (size_t c = 1; c < cells + 2 && status == KILN_OK; c++)
        g->first[c] += g->first[c - 1];
    return status;
}

/* Sorts the segments into cells by counting sort. Cells are made larger where long segments would make too many
 * entries. */
static int fill_grid(struct grid *g, double width, double height, struct kiln_error *error)
{
    size_grid(g, width, height);
    int status;
    KILN_TRY(count_entries(g, error));
    while (g->first[(size_t)g->across * g->down + 1] > ENTRIES_MAX && g->across * (uint64_t)g->down > 1) {
        choose_cell(g, 2.0 * g->cell, width, height);
        KILN_TRY(count_entries(g, error));
    }
    KILN_TRY(kiln_arena_allocate(&g->arena, &g->entries, g->first[(size_t)g->across * g->down + 1], sizeof *g->entries,
                                 "borders of charts", error));
    for (uint32_t i = 0; i < g->segment_count; i++)
        enter(g, i, false);
end:
    return status;
}

/* The distance (the larger of |x| and |y|) from a point to the nearest point of a segment. It is convex along the
 * segment; its minimum is at an end, where x or y is 0, or where |x| = |y|. */
static double distance_to(const struct segment *s, const double p[2])
{
    const double a = s->from[0] - p[0], c = s->from[1] - p[1], b = s->to[0] - s->from[0], d = s->to[1] - s->from[1];
    const double top[4] = {-a, -c, c - a, -a - c}, under[4] = {b, d, b - d, b + d};
    double best = fmin(fmax(fabs(a), fabs(c)), fmax(fabs(a + b), fabs(c + d)));
    for (int i = 0; i < 4; i++) {
        const double t = under[i] != 0.0 ? top[i] / under[i] : 0.0;
        if (t > 0.0 && t < 1.0)
            best = fmin(best, fmax(fabs(a + t * b), fabs(c + t * d)));
    }
    return best;
}

/* Whether the box around a segment is farther from a point than `distance`, by more than rounding errors. */
static bool is_beyond(const struct segment *s, const double p[2], double distance)
{
    const double reach = distance + TOLERANCE;
    return (s->from[0] > p[0] + reach && s->to[0] > p[0] + reach) ||
           (s->from[0] < p[0] - reach && s->to[0] < p[0] - reach) ||
           (s->from[1] > p[1] + reach && s->to[1] > p[1] + reach) ||
           (s->from[1] < p[1] - reach && s->to[1] < p[1] - reach);
}

static double nearest_in_cell(const struct grid *g, const double p[2], uint32_t chart, int64_t x, int64_t y,
                              double best)
{
    if (x < 0 || y < 0 || x >= g->across || y >= g->down)
        return best;
    const size_t cell = (size_t)y * g->across + (size_t)x;
    for (size_t i = g->first[cell + 1]; i < g->first[cell + 2]; i++) {
        const struct segment *s = &g->segments[g->entries[i]];
        if (s->chart != chart && !is_beyond(s, p, best))
            best = fmin(best, distance_to(s, p));
    }
    return best;
}

/* Returns the distance from a point of a chart to the nearest other chart, at most two texels. It searches growing
 * rings of cells. */
static double nearest_other(const struct grid *g, const double p[2], uint32_t chart)
{
    const int64_t cx = cell_at(p[0], g->cell, g->across), cy = cell_at(p[1], g->cell, g->down);
    double best = KILN_PADDING_TEXELS;
    for (int64_t r = 0; r <= (int64_t)g->rings && best > (double)(r - 1) * g->cell; r++)
        for (int64_t y = cy - r; y <= cy + r; y++) {
            const int64_t step = y == cy - r || y == cy + r || r == 0 ? 1 : 2 * r;
            for (int64_t x = cx - r; x <= cx + r; x += step)
                best = nearest_in_cell(g, p, chart, x, y, best);
        }
    return best;
}

/* ---- measuring ---- */

static void count_length(struct kiln_padding *padding, double distance, double length)
{
    padding->border += length;
    if (!(distance < KILN_PADDING_TEXELS - TOLERANCE))
        return;
    padding->close += length;
    const double step = KILN_PADDING_OCTAVE * log2(KILN_PADDING_TEXELS / distance);
    if (step < KILN_PADDING_STEPS)
        padding->by_factor[step > 0.0 ? (int)step : 0] += length;
}

static double length_of(const struct segment *s) { return hypot(s->to[0] - s->from[0], s->to[1] - s->from[1]); }

/* Samples all borders at even steps, as if they were one line. */
static void measure_segments(struct kiln_padding *padding, const struct grid *g, uint8_t *is_close)
{
    double total = 0.0;
    for (size_t i = 0; i < g->segment_count; i++)
        total += length_of(&g->segments[i]);
    const double step = fmax(STEP, total / SAMPLES_MAX);
    double left = 0.5 * step; /* length until the next sample */
    for (size_t i = 0; i < g->segment_count; i++) {
        const struct segment *s = &g->segments[i];
        const double length = length_of(s);
        double at = left;
        for (; at < length; at += step) {
            const double t = at / length,
                         p[2] = {s->from[0] + t * (s->to[0] - s->from[0]), s->from[1] + t * (s->to[1] - s->from[1])};
            const double distance = nearest_other(g, p, s->chart);
            count_length(padding, distance, step);
            is_close[s->chart] |= distance < KILN_PADDING_TEXELS - TOLERANCE;
        }
        left = at - length;
    }
}

static int list_segments(struct grid *g, const struct kiln_vec2 *uv, const uint32_t *triangles, size_t triangle_count,
                         const uint32_t *chart, const uint8_t *borders, const double size[2], struct kiln_error *error)
{
    size_t count = 0;
    for (size_t t = 0; t < triangle_count; t++)
        count += (size_t)__builtin_popcount(borders[t]);
    const int status =
        kiln_arena_allocate(&g->arena, &g->segments, count, sizeof *g->segments, "borders of charts", error);
    for (size_t e = 0; e < 3 * triangle_count && status == KILN_OK; e++) {
        if ((borders[e / 3] >> (e % 3) & 1u) == 0)
            continue;
        const struct kiln_vec2 a = uv[triangles[e]], b = uv[triangles[e - e % 3 + (e + 1) % 3]];
        if (a.x == b.x && a.y == b.y)
            continue;
        g->segments[g->segment_count++] = (struct segment){.from = {size[0] * (double)a.x, size[1] * (double)a.y},
                                                           .to = {size[0] * (double)b.x, size[1] * (double)b.y},
                                                           .chart = chart[e / 3]};
    }
    return status;
}

static void destroy_grid(struct grid *g) { kiln_arena_release(&g->arena); }

int kiln_padding_measure(struct kiln_padding *padding, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                         size_t vertex_count, const uint32_t *triangles, size_t triangle_count, double width,
                         double height, struct kiln_error *error)
{
    const double size[2] = {width, height};
    struct grid grid = {0};
    struct kiln_arena arena = {0};
    uint32_t *chart = NULL;
    uint8_t *borders = NULL, *is_close = NULL;
    *padding = (struct kiln_padding){0};
    int status;
    KILN_TRY(kiln_arena_allocate(&arena, &chart, triangle_count, sizeof *chart, "the charts of a layout", error));
    KILN_TRY(kiln_arena_allocate(&arena, &borders, triangle_count, 1, "the charts of a layout", error));
    KILN_TRY(kiln_padding_charts(positions, uv, vertex_count, triangles, triangle_count, chart, borders,
                                 &padding->charts, error));
    KILN_TRY(kiln_arena_allocate(&arena, &is_close, padding->charts, 1, "the charts of a layout", error));
    if (isfinite(width) && isfinite(height))
        KILN_TRY(list_segments(&grid, uv, triangles, triangle_count, chart, borders, size, error));
    KILN_TRY(fill_grid(&grid, width, height, error));
    measure_segments(padding, &grid, is_close);
    for (size_t i = 0; i < padding->charts; i++)
        padding->close_charts += is_close[i];
end:
    destroy_grid(&grid);
    kiln_arena_release(&arena);
    return status;
}

void kiln_padding_add(struct kiln_padding *sum, const struct kiln_padding *padding)
{
    sum->charts += padding->charts;
    sum->close_charts += padding->close_charts;
    sum->border += padding->border;
    sum->close += padding->close;
    for (int i = 0; i < KILN_PADDING_STEPS; i++)
        sum->by_factor[i] += padding->by_factor[i];
}

double kiln_padding_factor(const struct kiln_padding *padding, double fraction)
{
    double left = padding->close;
    if (left <= fraction * padding->border)
        return 1.0;
    for (int i = 0; i < KILN_PADDING_STEPS; i++) {
        left -= padding->by_factor[i];
        if (left <= fraction * padding->border)
            return exp2((double)(i + 1) / KILN_PADDING_OCTAVE);
    }
    return INFINITY;
}
