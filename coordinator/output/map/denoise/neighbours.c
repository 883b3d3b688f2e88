#include "coordinator/output/map/denoise/neighbours.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "coordinator/output/map/bands/slices.h"
#include "worker/base/arena.h"
#include "worker/base/clones.h"
#include "worker/base/memory.h"

/* Ring radii in texels: twice the scales of the regression (regression.h), where its weights reach 0. */
const float kiln_neighbour_rings[KILN_NEIGHBOUR_RINGS] = {1.5f, 2.0f, 3.0f, 4.0f, 6.0f, KILN_NEIGHBOUR_RADIUS};

enum { OUTSIDE = KILN_NEIGHBOUR_RINGS, FARTHEST = KILN_NEIGHBOUR_FARTHEST };

/* Largest distance of a neighbour from the tangent plane: off_most texels, or off_slope x d sin(angle). */
static const float off_most = 0.05f, off_slope = 0.6f;

/* A cell of the grid for texels of 2^level to 2^(level + 1) m. */
struct kiln_neighbour_cell {
    int32_t level, at[3];
};

/* The cells [first, end); all of them have this level. */
struct kiln_neighbour_level {
    int32_t level;
    size_t first, end;
};

/* A point that is sorted. */
struct entry {
    struct kiln_neighbour_cell cell;
    uint32_t order, at; /* at: in the array as it was given */
};

static int compare_cells(const struct kiln_neighbour_cell *a, const struct kiln_neighbour_cell *b)
{
    if (a->level != b->level)
        return a->level < b->level ? -1 : 1;
    for (int c = 0; c < 3; c++)
        if (a->at[c] != b->at[c])
            return a->at[c] < b->at[c] ? -1 : 1;
    return 0;
}

/* Binary search for the first of the cells [low, high) that is not before `key`; returns `high` if all are. */
static size_t search_cells(const struct kiln_neighbour_grid *g, size_t low, size_t high,
                           const struct kiln_neighbour_cell *key)
{
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (compare_cells(&g->cells[middle], key) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Same result as search_cells, by doubling steps from `low`: faster where the cell is near the front. */
static size_t search_ahead(const struct kiln_neighbour_grid *g, size_t low, size_t high,
                           const struct kiln_neighbour_cell *key)
{
    for (size_t step = 1; step < high - low; step *= 2) {
        if (compare_cells(&g->cells[low + step - 1], key) >= 0)
            return search_cells(g, low, low + step - 1, key);
        low += step;
    }
    return search_cells(g, low, high, key);
}

/* ---- sorting ---- */

/* Sort keys of points, the least significant first. */
enum { BY_ORDER, BY_Z, BY_Y, BY_X, BY_LEVEL, KEYS };

static int64_t key_of(const struct entry *entry, int key)
{
    return key == BY_ORDER ? (int64_t)entry->order : key == BY_LEVEL ? entry->cell.level : entry->cell.at[BY_X - key];
}

enum { DIGIT_BITS = 11, DIGITS = 1 << DIGIT_BITS };

/* Radix sort of entries, from the last digit on; each thread has a part of the entries. */
struct sort {
    size_t count;
    struct entry *entries, *spare;
    int threads;
    bool in_order; /* the entries come by their order */
    int64_t least[KEYS], most[KEYS];
    size_t (*places)[DIGITS]; /* per thread and digit: number of entries, then the place of the next one */
};

static struct entry make_entry(const struct kiln_neighbour_grid *g, size_t i)
{
    const struct kiln_neighbour_point *point = &g->points[i];
    struct entry entry = {{.level = kiln_neighbour_level(point->size)}, point->order, (uint32_t)i};
    const double scale = kiln_neighbour_scale(entry.cell.level);
    for (int c = 0; c < 3; c++)
        entry.cell.at[c] = kiln_neighbour_along(point->position[c], scale);
    return entry;
}

/* Makes the entries, and finds the ranges of their keys. */
static void make_entries(struct sort *s, const struct kiln_neighbour_grid *g)
{
    for (int k = 0; k < KEYS; k++) {
        s->least[k] = INT64_MAX;
        s->most[k] = INT64_MIN;
    }
    int64_t *least = s->least, *most = s->most;
    bool in_order = true;
#pragma omp parallel for num_threads(s->threads) schedule(static) reduction(min : least[:KEYS]) \
    reduction(max : most[:KEYS]) reduction(&& : in_order)
    for (size_t i = 0; i < s->count; i++) {
        s->entries[i] = make_entry(g, i);
        for (int k = 0; k < KEYS; k++) {
            const int64_t key = key_of(&s->entries[i], k);
            least[k] = key < least[k] ? key : least[k];
            most[k] = key > most[k] ? key : most[k];
        }
        in_order = in_order && (i == 0 || g->points[i - 1].order < g->points[i].order);
    }
    s->in_order = in_order;
}

static size_t digit_of(const struct sort *s, const struct entry *entry, int key, int shift)
{
    return (size_t)((key_of(entry, key) - s->least[key]) >> shift) & (DIGITS - 1);
}

/* Computes the first place of each thread and digit; there are `digits` values of a digit. */
static void find_places(const struct sort *s, size_t digits)
{
    for (size_t d = 0, sum = 0; d < digits; d++)
        for (int t = 0; t < s->threads; t++) {
            const size_t here = s->places[t][d];
            s->places[t][d] = sum;
            sum += here;
        }
}

/* Sorts by one digit; entries with equal digits keep their order. */
static void sort_by_digit(struct sort *s, int key, int shift)
{
    const int64_t most = (s->most[key] - s->least[key]) >> shift;
    const size_t digits = most < DIGITS ? (size_t)most + 1 : DIGITS;
#pragma omp parallel num_threads(s->threads)
    {
#pragma omp for schedule(static)
        for (int t = 0; t < s->threads; t++) {
            size_t begin, end;
            kiln_slice(s->threads, t, s->count, &begin, &end);
            memset(s->places[t], 0, digits * sizeof **s->places);
            for (size_t i = begin; i < end; i++)
                s->places[t][digit_of(s, &s->entries[i], key, shift)]++;
        }
#pragma omp single
        find_places(s, digits);
#pragma omp for schedule(static)
        for (int t = 0; t < s->threads; t++) {
            size_t begin, end;
            kiln_slice(s->threads, t, s->count, &begin, &end);
            for (size_t i = begin; i < end; i++)
                s->spare[s->places[t][digit_of(s, &s->entries[i], key, shift)]++] = s->entries[i];
        }
    }
    struct entry *const sorted = s->spare;
    s->spare = s->entries;
    s->entries = sorted;
}

static int sort_entries(struct sort *s, const struct kiln_neighbour_grid *g, struct kiln_error *error)
{
    s->threads = kiln_slices(s->count);
    int status;
    KILN_TRY(kiln_allocate_bare(&s->entries, s->count, sizeof *s->entries, "the order of surface points", error));
    KILN_TRY(kiln_allocate_bare(&s->spare, s->count, sizeof *s->spare, "the order of surface points", error));
    KILN_TRY(
        kiln_allocate_bare(&s->places, (size_t)s->threads, sizeof *s->places, "the order of surface points", error));
end:
    if (status != KILN_OK)
        return status;
    make_entries(s, g);
    for (int key = s->in_order ? BY_Z : BY_ORDER; key < KEYS; key++)
        for (int shift = 0; (s->most[key] - s->least[key]) >> shift > 0; shift += DIGIT_BITS)
            sort_by_digit(s, key, shift);
    kiln_free(&s->spare);
    return KILN_OK;
}

/* ---- cells ---- */

static bool begins_cell(const struct sort *s, size_t i)
{
    return i == 0 || compare_cells(&s->entries[i].cell, &s->entries[i - 1].cell) != 0;
}

/* Lists the cells. `before` tells each thread how many cells begin in the parts of earlier threads. */
static void list_cells(struct kiln_neighbour_grid *g, const struct sort *s, const size_t *before)
{
#pragma omp parallel for num_threads(s->threads) schedule(static)
    for (int t = 0; t < s->threads; t++) {
        size_t begin, end, cell = before[t];
        kiln_slice(s->threads, t, s->count, &begin, &end);
        for (size_t i = begin; i < end; i++) {
            if (!begins_cell(s, i))
                continue;
            g->cells[cell] = s->entries[i].cell;
            g->first[cell++] = (uint32_t)i;
        }
    }
    g->first[g->cell_count] = (uint32_t)g->count;
}

/* Makes the cells of sorted entries. */
static int make_cells(struct kiln_neighbour_grid *g, const struct sort *s, struct kiln_error *error)
{
    size_t *before = NULL;
    int status = kiln_allocate(&before, (size_t)s->threads + 1, sizeof *before, "the cells of surface points", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads(s->threads) schedule(static)
    for (int t = 0; t < s->threads; t++) {
        size_t begin, end, cells = 0;
        kiln_slice(s->threads, t, s->count, &begin, &end);
        for (size_t i = begin; i < end; i++)
            cells += begins_cell(s, i);
        before[t + 1] = cells;
    }
    for (int t = 0; t < s->threads; t++)
        before[t + 1] += before[t];
    g->cell_count = before[s->threads];
    KILN_TRY(kiln_arena_allocate_bare(&g->arena, &g->cells, g->cell_count, sizeof *g->cells,
                                      "the cells of surface points", error));
    KILN_TRY(kiln_arena_allocate_bare(&g->arena, &g->first, g->cell_count + 1, sizeof *g->first,
                                      "the cells of surface points", error));
    list_cells(g, s, before);
end:
    kiln_free(&before);
    return status;
}

/* Finds the cells of each level. */
static int make_levels(struct kiln_neighbour_grid *g, struct kiln_error *error)
{
    size_t room = 0;
    int status = KILN_OK;
    for (size_t first = 0, end; first < g->cell_count && status == KILN_OK; first = end) {
        const int32_t level = g->cells[first].level;
        const struct kiln_neighbour_cell next = {level + 1, {INT32_MIN, INT32_MIN, INT32_MIN}};
        end = search_cells(g, first, g->cell_count, &next);
        status = kiln_arena_grow(&g->arena, &g->levels, &room, g->level_count + 1, sizeof *g->levels,
                                 "the cells of surface points", error);
        if (status == KILN_OK)
            g->levels[g->level_count++] = (struct kiln_neighbour_level){level, first, end};
    }
    return status;
}

/* Reorders the points as the entries are sorted. */
static int reorder(struct kiln_neighbour_grid *g, const struct sort *s, struct kiln_error *error)
{
    struct kiln_neighbour_point *sorted = NULL;
    const int status = kiln_allocate_bare(&sorted, g->count, sizeof *sorted, "the order of surface points", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads(s->threads) schedule(static)
    for (size_t i = 0; i < g->count; i++)
        sorted[i] = g->points[s->entries[i].at];
    kiln_free(&g->points);
    g->points = sorted;
    return KILN_OK;
}

static int sort_points(struct kiln_neighbour_grid *g, struct kiln_error *error)
{
    struct sort s = {.count = g->count};
    int status;
    KILN_TRY(sort_entries(&s, g, error));
    KILN_TRY(make_cells(g, &s, error));
    KILN_TRY(make_levels(g, error));
    KILN_TRY(reorder(g, &s, error));
end:
    kiln_free(&s.entries);
    kiln_free(&s.spare);
    kiln_free(&s.places);
    return status;
}

int kiln_neighbour_grid_create(struct kiln_neighbour_grid **grid, struct kiln_neighbour_point **points, size_t count,
                               struct kiln_error *error)
{
    int status = kiln_allocate(grid, 1, sizeof **grid, "the neighbours of surface points", error);
    if (status == KILN_OK) {
        (*grid)->points = *points;
        (*grid)->count = count;
        *points = NULL;
        status = sort_points(*grid, error);
    }
    kiln_free(points);
    if (status != KILN_OK)
        kiln_neighbour_grid_destroy(grid);
    return status;
}

void kiln_neighbour_grid_destroy(struct kiln_neighbour_grid **grid)
{
    struct kiln_neighbour_grid *g = *grid;
    if (g == NULL)
        return;
    kiln_free(&g->points);
    kiln_arena_release(&g->arena);
    kiln_free(grid);
}

/* ---- candidates ---- */

/* A box in space, and the candidates found in it so far. */
struct box {
    float low[3], high[3];
    uint64_t met;
    uint32_t stride; /* every how many of them is taken */
};

/* Drops every second candidate, when there is no room for more. */
static void thin_out(struct kiln_neighbours *n, struct box *box)
{
    for (size_t i = 0; 2 * i < n->candidates; i++)
        n->candidate[i] = n->candidate[2 * i];
    n->candidates = (n->candidates + 1) / 2;
    n->thinned = true;
    box->stride *= 2;
}

static void take_cell(struct kiln_neighbours *n, const struct kiln_neighbour_grid *g, size_t cell, struct box *box)
{
    for (uint32_t i = g->first[cell]; i < g->first[cell + 1]; i++) {
        const float *p = g->points[i].position;
        if (p[0] < box->low[0] || p[0] > box->high[0] || p[1] < box->low[1] || p[1] > box->high[1] ||
            p[2] < box->low[2] || p[2] > box->high[2])
            continue;
        if (box->met++ % box->stride != 0)
            continue;
        if (n->candidates == KILN_NEIGHBOURS_MOST)
            thin_out(n, box);
        n->candidate[n->candidates++] = i;
    }
}

/* Bounding box of the cell's points, enlarged by `radius` texels of each point. */
static struct box box_of(const struct kiln_neighbour_grid *g, size_t cell, float radius)
{
    struct box box = {.stride = 1};
    float reach = 0.0f;
    for (uint32_t i = g->first[cell]; i < g->first[cell + 1]; i++)
        for (int c = 0; c < 3; c++) {
            const float at = g->points[i].position[c];
            box.low[c] = i == g->first[cell] ? at : fminf(box.low[c], at);
            box.high[c] = i == g->first[cell] ? at : fmaxf(box.high[c], at);
            reach = fmaxf(reach, radius * g->points[i].size);
        }
    for (int c = 0; c < 3; c++) {
        box.low[c] -= reach;
        box.high[c] += reach;
    }
    return box;
}

/* Callback for cells [first, end) that touch a box. */
typedef void (*take_cells)(void *context, const struct kiln_neighbour_grid *g, size_t first, size_t end,
                           struct box *box);

/* Visits the cells of one column, which follow one another along z. `from`: start of the search, moved to the column's
 * end. */
static void take_column(const struct kiln_neighbour_grid *g, const struct kiln_neighbour_cell *begin,
                        const struct kiln_neighbour_cell *last, size_t *from, size_t to, struct box *box,
                        take_cells take, void *context)
{
    const size_t first = search_ahead(g, *from, to, begin);
    size_t end = first;
    while (end < to && compare_cells(&g->cells[end], last) <= 0)
        end++;
    *from = end;
    if (end > first)
        take(context, g, first, end, box);
}

static void take_level(const struct kiln_neighbour_grid *g, const struct kiln_neighbour_level *level, struct box *box,
                       take_cells take, void *context)
{
    struct kiln_neighbour_cell begin = {.level = level->level}, end = {.level = level->level};
    const double scale = kiln_neighbour_scale(level->level);
    int32_t low[3], high[3];
    for (int c = 0; c < 3; c++) {
        low[c] = kiln_neighbour_along(box->low[c], scale);
        high[c] = kiln_neighbour_along(box->high[c], scale);
    }
    begin.at[0] = low[0];
    begin.at[1] = low[1];
    begin.at[2] = low[2];
    end.at[2] = high[2];
    size_t from = search_cells(g, level->first, level->end, &begin);
    for (int32_t x = low[0]; x <= high[0]; x++)
        for (int32_t y = low[1]; y <= high[1]; y++) {
            begin.at[0] = end.at[0] = x;
            begin.at[1] = end.at[1] = y;
            take_column(g, &begin, &end, &from, level->end, box, take, context);
        }
}

/* Visits all cells that touch the box of a cell, by level and along the axes. */
static void take_levels(const struct kiln_neighbour_grid *g, size_t cell, float radius, take_cells take, void *context)
{
    struct box box = box_of(g, cell, radius);
    const int32_t own = g->cells[cell].level;
    for (size_t i = 0; i < g->level_count; i++)
        if (g->levels[i].level >= own - 1 && g->levels[i].level <= own + 1)
            take_level(g, &g->levels[i], &box, take, context);
}

static void take_candidates(void *context, const struct kiln_neighbour_grid *g, size_t first, size_t end,
                            struct box *box)
{
    for (size_t i = first; i < end; i++)
        take_cell(context, g, i, box);
}

void kiln_neighbours_collect(struct kiln_neighbours *n, const struct kiln_neighbour_grid *g, size_t cell, float radius)
{
    n->candidates = n->found_count = 0;
    n->thinned = n->full = false;
    n->kept = NULL;
    take_levels(g, cell, radius, take_candidates, n);
    for (size_t i = 0; i < n->candidates; i++) {
        const struct kiln_neighbour_point *p = &g->points[n->candidate[i]];
        for (int c = 0; c < 3; c++) {
            n->of.position[c][i] = p->position[c];
            n->of.normal[c][i] = p->normal[c];
        }
        n->of.area[i] = p->area;
    }
}

/* ---- ranges ---- */

/* List of cell ranges made by one thread, cell after cell. */
struct range_list {
    uint32_t (*ranges)[2];
    size_t count, room;
    size_t first;    /* of the cell at hand */
    uint64_t places; /* of its ranges */
    int status;
    struct kiln_error error;
};

static void add_range(struct range_list *l, uint32_t begin, uint32_t end)
{
    const bool follows = l->count > l->first && begin == l->ranges[l->count - 1][1];
    l->places += end - begin;
    if (follows) {
        l->ranges[l->count - 1][1] = end;
        return;
    }
    if (l->status == KILN_OK)
        l->status =
            kiln_grow(&l->ranges, &l->room, l->count + 1, sizeof *l->ranges, "the cells of surface points", &l->error);
    if (l->status != KILN_OK)
        return;
    l->ranges[l->count][0] = begin;
    l->ranges[l->count++][1] = end;
}

static void take_range(void *context, const struct kiln_neighbour_grid *g, size_t first, size_t end, struct box *box)
{
    (void)box;
    add_range(context, g->first[first], g->first[end]);
}

static void list_cell(struct range_list *l, const struct kiln_neighbour_grid *g, size_t cell, struct kiln_neighbours *n)
{
    l->first = l->count;
    l->places = 0;
    take_levels(g, cell, KILN_NEIGHBOUR_RADIUS, take_range, l);
    if (l->places <= KILN_NEIGHBOURS_MOST_TWICE)
        return;
    l->count = l->first;
    kiln_neighbours_collect(n, g, cell, KILN_NEIGHBOUR_RADIUS);
    for (size_t i = 0; i < n->candidates; i++)
        add_range(l, n->candidate[i], n->candidate[i] + 1);
}

/* Lists the ranges for a slice of the cells. r->first[c + 1]: end of cell c's ranges within the slice's list. */
static void list_slice(struct kiln_neighbour_ranges *r, const struct kiln_neighbour_grid *g, size_t begin, size_t end,
                       struct range_list *l)
{
    struct kiln_neighbours *n = NULL;
    l->status = kiln_allocate(&n, 1, sizeof *n, "the neighbours of a point", &l->error);
    for (size_t cell = begin; cell < end && l->status == KILN_OK; cell++) {
        list_cell(l, g, cell, n);
        if (l->status == KILN_OK && l->count > UINT32_MAX)
            l->status = kiln_fail(&l->error, KILN_SYSTEM,
                                  "%zu surface points have too many neighbours; use --denoise none", g->count);
        r->first[cell + 1] = (uint32_t)l->count;
        for (uint32_t i = g->first[cell]; i < g->first[cell + 1]; i++)
            r->cells[i] = (uint32_t)cell;
    }
    kiln_free(&n);
}

/* Concatenates the range lists of all slices. */
static int join_slices(struct kiln_neighbour_ranges *r, const struct kiln_neighbour_grid *g, struct range_list *lists,
                       int slices, struct kiln_error *error)
{
    uint64_t all = 0;
    int status = KILN_OK;
    for (int t = 0; t < slices; t++) {
        lists[t].first = (size_t)all;
        all += lists[t].count;
        if (lists[t].status != KILN_OK)
            KILN_TRY(kiln_fail(error, lists[t].status, "%s", lists[t].error.message));
    }
    if (all > UINT32_MAX)
        KILN_TRY(
            kiln_fail(error, KILN_SYSTEM, "%zu surface points have too many neighbours; use --denoise none", g->count));
    KILN_TRY(kiln_arena_allocate_bare(&r->arena, &r->ranges, (size_t)all, sizeof *r->ranges,
                                      "the cells of surface points", error));
end:
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads(slices) schedule(static)
    for (int t = 0; t < slices; t++) {
        size_t begin, end;
        kiln_slice(slices, t, g->cell_count, &begin, &end);
        for (size_t cell = begin; cell < end; cell++)
            r->first[cell + 1] += (uint32_t)lists[t].first;
        if (lists[t].count > 0)
            memcpy(r->ranges + lists[t].first, lists[t].ranges, lists[t].count * sizeof *r->ranges);
    }
    return KILN_OK;
}

int kiln_neighbour_ranges_list(struct kiln_neighbour_ranges *r, const struct kiln_neighbour_grid *g,
                               struct kiln_error *error)
{
    struct range_list *lists = NULL;
    const int slices = kiln_slices(g->count);
    *r = (struct kiln_neighbour_ranges){0};
    int status;
    KILN_TRY(kiln_arena_allocate_bare(&r->arena, &r->cells, g->count, sizeof *r->cells, "the cells of surface points",
                                      error));
    KILN_TRY(kiln_arena_allocate_bare(&r->arena, &r->first, g->cell_count + 1, sizeof *r->first,
                                      "the cells of surface points", error));
    KILN_TRY(kiln_allocate(&lists, (size_t)slices, sizeof *lists, "the cells of surface points", error));
    r->first[0] = 0;
#pragma omp parallel for num_threads(slices) schedule(static)
    for (int t = 0; t < slices; t++) {
        size_t begin, end;
        kiln_slice(slices, t, g->cell_count, &begin, &end);
        list_slice(r, g, begin, end, &lists[t]);
    }
    KILN_TRY(join_slices(r, g, lists, slices, error));
end:
    for (int t = 0; lists != NULL && t < slices; t++)
        kiln_free(&lists[t].ranges);
    kiln_free(&lists);
    return status;
}

void kiln_neighbour_ranges_release(struct kiln_neighbour_ranges *ranges) { kiln_arena_release(&ranges->arena); }

/* ---- neighbours ---- */

/* Two unit vectors that are orthogonal to a third and to each other (Duff et al., "Building an Orthonormal Basis,
 * Revisited", JCGT 2017). */
static void make_basis(const float n[3], float t[3], float b[3])
{
    const float sign = copysignf(1.0f, n[2]), p = -1.0f / (sign + n[2]), q = n[0] * n[1] * p;
    t[0] = 1.0f + sign * n[0] * n[0] * p;
    t[1] = sign * q;
    t[2] = -sign * n[0];
    b[0] = q;
    b[1] = sign + n[1] * n[1] * p;
    b[2] = -n[1];
}

/* Computes the ring of all candidates, OUTSIDE for the point itself, and counts `within`. No branches, so that the loop
 * is vectorized. */
static inline void classify(struct kiln_neighbours *n, const struct kiln_neighbour_point *p, uint32_t place,
                            float radius)
{
    const float ax = p->position[0], ay = p->position[1], az = p->position[2], nx = p->normal[0], ny = p->normal[1],
                nz = p->normal[2], inverse = 1.0f / p->size, most = radius * radius, slope = off_slope * off_slope;
    float t[3], b[3];
    make_basis(p->normal, t, b);
    const float tx = t[0], ty = t[1], tz = t[2], bx = b[0], by = b[1], bz = b[2];
    const size_t count = n->candidates;
    int32_t in0 = 0, in1 = 0, in2 = 0, in3 = 0, in4 = 0, in5 = 0;
#pragma omp simd reduction(+ : in0, in1, in2, in3, in4, in5)
    for (size_t i = 0; i < count; i++) {
        const float dx = (n->of.position[0][i] - ax) * inverse, dy = (n->of.position[1][i] - ay) * inverse,
                    dz = (n->of.position[2][i] - az) * inverse, square = dx * dx + dy * dy + dz * dz;
        const float cosine = n->of.normal[0][i] * nx + n->of.normal[1][i] * ny + n->of.normal[2][i] * nz;
        const float off = fabsf(dx * nx + dy * ny + dz * nz) - off_most, sine = fabsf(1.0f - cosine * cosine);
        const float x = dx * tx + dy * ty + dz * tz, y = dx * bx + dy * by + dz * bz, r = x * x + y * y;
        const int ring = (r >= 2.25f) + (r >= 4.0f) + (r >= 9.0f) + (r >= 16.0f) + (r >= 36.0f);
        const int flat = (off <= 0.0f) | (off * off <= slope * square * sine);
        const int near = (square < most) & (cosine >= KILN_NEIGHBOUR_COSINE) & flat & (n->candidate[i] != place);
        const int32_t at = near * ring + (1 - near) * OUTSIDE;
        n->ring[i] = at;
        in0 += at <= 0;
        in1 += at <= 1;
        in2 += at <= 2;
        in3 += at <= 3;
        in4 += at <= 4;
        in5 += at <= 5;
    }
    const size_t within[KILN_NEIGHBOUR_RINGS] = {(size_t)in0, (size_t)in1, (size_t)in2,
                                                 (size_t)in3, (size_t)in4, (size_t)in5};
    memcpy(n->within, within, sizeof within);
}

/* Lists the candidates that lie in a ring. Returns their number. */
static inline size_t list_near(struct kiln_neighbours *n)
{
    size_t count = 0;
    for (size_t i = 0; i < n->candidates; i++) {
        n->near[count] = (uint32_t)i;
        count += (size_t)(n->ring[i] != OUTSIDE);
    }
    return count;
}

/* Searches the neighbours of a place among the candidates. Returns their list, which follows those of the cell's places
 * before. */
static inline __attribute__((always_inline)) const uint16_t *search(struct kiln_neighbours *n,
                                                                    const struct kiln_neighbour_grid *g, size_t place,
                                                                    float radius)
{
    size_t next[KILN_NEIGHBOUR_RINGS] = {0};
    classify(n, &g->points[place], (uint32_t)place, radius);
    const size_t count = list_near(n), numbers = KILN_NEIGHBOUR_RINGS + count;
    n->full = n->full || n->found_count + numbers > KILN_NEIGHBOURS_FOUND;
    n->found_count = n->full ? 0 : n->found_count;
    uint16_t *list = n->found + n->found_count;
    for (size_t r = 0; r < KILN_NEIGHBOUR_RINGS; r++)
        list[r] = (uint16_t)n->within[r];
    memcpy(next + 1, n->within, sizeof next - sizeof *next);
    for (size_t k = 0; k < count; k++) {
        const size_t i = n->near[k];
        list[KILN_NEIGHBOUR_RINGS + next[n->ring[i]]++] = (uint16_t)i;
    }
    n->found_count += numbers;
    return list;
}

/* Drops neighbours that a search within the radius would not find: those outside it in space, though not in the tangent
 * plane. `square`: of the neighbours' distances. */
static void drop_outside(struct kiln_neighbours *n, size_t rings, float radius, const float *square)
{
    size_t from = 0, to = 0;
    for (size_t r = 0; r < rings; r++) {
        for (; from < n->within[r]; from++) {
            n->place[to] = n->place[from];
            n->x[to] = n->x[from];
            n->y[to] = n->y[from];
            n->area[to] = n->area[from];
            to += square[from] < radius * radius;
        }
        n->within[r] = to;
    }
}

/* Takes the neighbours within the radius from a list of those within at least that radius. */
static inline __attribute__((always_inline)) void take_list(struct kiln_neighbours *n,
                                                            const struct kiln_neighbour_point *p, const uint16_t *list,
                                                            float radius)
{
    const float ax = p->position[0], ay = p->position[1], az = p->position[2], inverse = 1.0f / p->size,
                most = radius * radius;
    const uint16_t *const candidates = list + KILN_NEIGHBOUR_RINGS;
    size_t rings = 0;
    for (; rings < KILN_NEIGHBOUR_RINGS && kiln_neighbour_rings[rings] <= radius; rings++)
        n->within[rings] = list[rings];
    float t[3], b[3];
    make_basis(p->normal, t, b);
    const float tx = t[0], ty = t[1], tz = t[2], bx = b[0], by = b[1], bz = b[2];
    const size_t count = n->within[rings - 1];
    int32_t outside = 0;
#pragma omp simd reduction(+ : outside)
    for (size_t k = 0; k < count; k++) {
        const uint32_t i = candidates[k];
        const float dx = (n->of.position[0][i] - ax) * inverse, dy = (n->of.position[1][i] - ay) * inverse,
                    dz = (n->of.position[2][i] - az) * inverse, square = dx * dx + dy * dy + dz * dz;
        n->x[k] = dx * tx + dy * ty + dz * tz;
        n->y[k] = dx * bx + dy * by + dz * bz;
        n->area[k] = n->of.area[i];
        n->place[k] = n->candidate[i];
        n->square[k] = square;
        outside += !(square < most);
    }
    if (outside > 0)
        drop_outside(n, rings, radius, n->square);
}

KILN_CLONES void kiln_neighbours_find(struct kiln_neighbours *n, const struct kiln_neighbour_grid *g, size_t place,
                                      float radius)
{
    const uint16_t *const list = n->kept != NULL ? n->kept : search(n, g, place, radius);
    if (n->kept != NULL)
        n->kept = list + KILN_NEIGHBOUR_RINGS + list[KILN_NEIGHBOUR_RINGS - 1];
    take_list(n, &g->points[place], list, radius);
}

/* ---- kept neighbours ---- */

int kiln_neighbours_kept_create(struct kiln_neighbours_kept *kept, const struct kiln_neighbour_grid *g, size_t most,
                                struct kiln_error *error)
{
    *kept = (struct kiln_neighbours_kept){.cell_count = g->cell_count, .left = most};
    return kiln_allocate(&kept->cells, kept->cell_count, sizeof *kept->cells, "the neighbours of surface points",
                         error);
}

void kiln_neighbours_kept_release(struct kiln_neighbours_kept *kept)
{
    for (size_t c = 0; kept->cells != NULL && c < kept->cell_count; c++)
        kiln_free(&kept->cells[c]);
    kiln_free(&kept->cells);
}

void kiln_neighbours_collect_kept(struct kiln_neighbours *n, const struct kiln_neighbour_grid *g,
                                  const struct kiln_neighbours_kept *kept, size_t cell, float radius)
{
    const uint16_t *list = kept->cells[cell];
    kiln_neighbours_collect(n, g, cell, list != NULL ? KILN_NEIGHBOUR_RADIUS : radius);
    n->kept = list;
}

void kiln_neighbours_keep(const struct kiln_neighbours *n, struct kiln_neighbours_kept *kept, size_t cell)
{
    const size_t bytes = n->found_count * sizeof *n->found;
    struct kiln_error ignored = {{0}}; /* without memory for them they are searched again */
    bool fits = !n->thinned && !n->full && n->kept == NULL;
    if (fits)
#pragma omp critical(kiln_neighbours_keep)
    {
        fits = bytes <= kept->left;
        kept->left -= fits ? bytes : 0;
    }
    if (fits && kiln_allocate_bare(&kept->cells[cell], n->found_count, sizeof *n->found,
                                   "the neighbours of surface points", &ignored) == KILN_OK)
        memcpy(kept->cells[cell], n->found, bytes);
}
