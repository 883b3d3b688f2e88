#include "coordinator/export/atlas.h"

#include <stdlib.h>
#include <string.h>

#include "coordinator/layout/raster.h"
#include "worker/base/arena.h"
#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"

enum { CLASSES = 24 }; /* size classes: half octaves of the longer side, up to 2^12, and one for all beyond */

/* ---- islands ---- */

/* Unites wanted texels that are less than three apart: they would share a neighbour. */
static void join_near(uint32_t *parent, const uint8_t *wanted, int64_t width, int64_t height)
{
    for (int64_t y = 0; y < height; y++)
        for (int64_t x = 0; x < width; x++) {
            if (wanted[y * width + x] == 0)
                continue;
            for (int64_t v = y; v <= y + 2 && v < height; v++)
                for (int64_t u = v == y ? x + 1 : x - 2; u <= x + 2 && u < width; u++)
                    if (u >= 0 && wanted[v * width + u] != 0)
                        kiln_sets_join(parent, (uint32_t)(y * width + x), (uint32_t)(v * width + u));
        }
}

/* Labels the texels and their neighbours with their island's number + 1 (0: none), in a grid that is one texel larger
 * on each side. Islands are numbered by their first texel. `parent` receives the roots' numbers. Returns the number of
 * islands. */
static uint32_t label(uint32_t *labels, uint32_t *parent, const uint8_t *wanted, uint32_t width, uint32_t height,
                      bool whole)
{
    const size_t stride = (size_t)width + 2;
    uint32_t count = 0;
    for (uint32_t i = 0; i < width * height; i++)
        if (wanted[i] != 0)
            parent[i] = kiln_sets_root(parent, i); /* a set's root comes before all its other members */
    for (uint32_t i = 0; i < width * height; i++) {
        if (wanted[i] == 0)
            continue;
        const uint32_t number = whole ? 1 : parent[i] == i ? count + 1 : parent[parent[i]];
        count = number > count ? number : count;
        for (size_t v = 0; v < 3; v++)
            for (size_t u = 0; u < 3; u++)
                labels[(i / width + v) * stride + i % width + u] = number;
        parent[i] = parent[i] == i ? number : parent[i];
    }
    return count;
}

static int add_run(struct kiln_island *o, uint32_t row, uint32_t first, uint32_t end, struct kiln_error *error)
{
    const int status = kiln_grow(&o->runs, &o->run_capacity, o->run_count + 1, sizeof *o->runs, "an island", error);
    if (status == KILN_OK)
        o->runs[o->run_count++] = (struct kiln_island_run){row, first, end};
    return status;
}

static int collect_runs(struct kiln_island *islands, const uint32_t *labels, uint32_t width, uint32_t height,
                        struct kiln_error *error)
{
    int status = KILN_OK;
    for (uint32_t y = 0; y < height + 2; y++)
        for (uint32_t x = 0; x < width + 2 && status == KILN_OK;) {
            const uint32_t *row = labels + (size_t)y * (width + 2), first = x, own = row[x];
            while (x < width + 2 && row[x] == own)
                x++;
            if (own != 0)
                status = add_run(&islands[own - 1], y, first, x, error);
        }
    return status;
}

/* Shrinks the island's box to its runs, and counts texels. Runs were made relative to (-1, -1). */
static void trim(struct kiln_island *o)
{
    uint32_t left = UINT32_MAX, right = 0;
    const uint32_t top = o->runs[0].row, bottom = o->runs[o->run_count - 1].row;
    for (size_t i = 0; i < o->run_count; i++) {
        left = o->runs[i].first < left ? o->runs[i].first : left;
        right = o->runs[i].end > right ? o->runs[i].end : right;
        o->texels += o->runs[i].end - o->runs[i].first;
    }
    for (size_t i = 0; i < o->run_count; i++) {
        o->runs[i].row -= top;
        o->runs[i].first -= left;
        o->runs[i].end -= left;
    }
    o->left = (int32_t)left - 1;
    o->top = (int32_t)top - 1;
    o->width = right - left;
    o->height = bottom - top + 1;
}

int kiln_islands_add(struct kiln_islands *all, const uint8_t *wanted, uint32_t width, uint32_t height, bool whole,
                     uint32_t group, struct kiln_error *error)
{
    uint32_t *parent = NULL, *labels = NULL, count = 0;
    if ((uint64_t)width * height >= UINT32_MAX)
        return kiln_fail(error, KILN_BAD_INPUT, "a lightmap of %u x %u texels is too large for an atlas", width,
                         height);
    int status;
    KILN_TRY(kiln_allocate(&parent, (size_t)width * height, sizeof *parent, "islands", error));
    KILN_TRY(kiln_allocate(&labels, ((size_t)width + 2) * ((size_t)height + 2), sizeof *labels, "islands", error));
    for (uint32_t i = 0; i < width * height; i++)
        parent[i] = i;
    if (!whole)
        join_near(parent, wanted, width, height);
    count = label(labels, parent, wanted, width, height, whole);
    if (count == 0)
        count = labels[(size_t)width + 3] = 1; /* no texel is wanted: the first one is used */
    KILN_TRY(kiln_grow(&all->islands, &all->capacity, all->count + count, sizeof *all->islands, "islands", error));
    struct kiln_island *own = all->islands + all->count;
    memset(own, 0, count * sizeof *own);
    all->count += count;
    KILN_TRY(collect_runs(own, labels, width, height, error));
    for (uint32_t i = 0; i < count; i++) {
        own[i].group = group;
        trim(&own[i]);
    }
end:
    kiln_free(&labels);
    kiln_free(&parent);
    return status;
}

void kiln_islands_free(struct kiln_islands *all)
{
    for (size_t i = 0; i < all->count; i++)
        kiln_free(&all->islands[i].runs);
    kiln_free(&all->islands);
    all->count = all->capacity = 0;
}

/* ---- packing ---- */

struct packer {
    uint32_t side;
    size_t words;
    /* The current page. */
    struct kiln_bitmap cells;          /* set: taken */
    uint32_t filled;                   /* rows from here on are empty */
    uint64_t *window, *blocked;        /* one row each */
    struct kiln_island_run *by_length; /* runs of the current island, longest first */
    size_t by_length_capacity;
    /* the row where the last island of similar size was placed: the search begins there */
    uint32_t cursor[CLASSES][CLASSES];
    struct kiln_arena arena;
};

/* target(x) |= in(x + by). Both may be the same row. */
static void or_shifted(uint64_t *target, const uint64_t *in, size_t words, uint32_t by)
{
    const size_t whole = by / 64;
    const uint32_t part = by % 64;
    for (size_t i = 0; i + whole < words; i++) {
        const uint64_t low = in[i + whole], high = part != 0 && i + whole + 1 < words ? in[i + whole + 1] : 0;
        target[i] |= part == 0 ? low : low >> part | high << (64 - part);
    }
}

/* window(x) = whether any of row(x) .. row(x + length - 1) is set, by repeated doubling. */
static void slide(struct packer *p, const uint64_t *row, uint32_t length)
{
    uint32_t reach = 1;
    memcpy(p->window, row, p->words * sizeof *row);
    for (; 2 * reach <= length; reach *= 2)
        or_shifted(p->window, p->window, p->words, reach); /* ascending words: each is read before it is changed */
    if (reach < length)
        or_shifted(p->window, p->window, p->words, length - reach);
}

static bool all_set(const uint64_t *row, size_t words)
{
    for (size_t i = 0; i < words; i++)
        if (~row[i] != 0)
            return false;
    return true;
}

/* Marks the columns where the island may not begin: all except 0 .. last. */
static void begin_blocked(struct packer *p, uint32_t last)
{
    for (size_t i = 0; i < p->words; i++) {
        const uint64_t from = 64 * (uint64_t)i;
        p->blocked[i] = from > last ? ~0ull : last - from >= 63 ? 0 : ~0ull << (last - from + 1);
    }
}

/* Finds the first free column for the island with its corner in row y; false: none. */
static bool find_column(struct packer *p, const struct kiln_island *o, uint32_t y, uint32_t *x)
{
    begin_blocked(p, p->side - o->width);
    for (size_t i = 0; i < o->run_count; i++) {
        const struct kiln_island_run *run = &p->by_length[i];
        if (y + run->row >= p->filled)
            continue;
        slide(p, p->cells.words + (size_t)(y + run->row) * p->cells.stride, run->end - run->first);
        or_shifted(p->blocked, p->window, p->words, run->first);
        if (all_set(p->blocked, p->words))
            return false;
    }
    for (size_t i = 0; i < p->words; i++)
        if (~p->blocked[i] != 0) {
            *x = (uint32_t)(64 * i) + (uint32_t)__builtin_ctzll(~p->blocked[i]);
            return true;
        }
    return false;
}

/* Compares runs for sorting: long ones first, since they rule out most columns; equal ones by position, so that the
 * order is unique. */
static int compare_runs(const void *a, const void *b)
{
    const struct kiln_island_run *p = a, *q = b;
    const uint32_t m = p->end - p->first, n = q->end - q->first;
    if (m != n)
        return m > n ? -1 : 1;
    return p->row != q->row ? (p->row < q->row ? -1 : 1) : p->first < q->first ? -1 : p->first > q->first;
}

static void take_place(struct packer *p, struct kiln_island *o, uint32_t x, uint32_t y)
{
    for (size_t i = 0; i < o->run_count; i++)
        (void)kiln_bitmap_set_run(&p->cells, y + o->runs[i].row, x + o->runs[i].first, x + o->runs[i].end);
    p->filled = y + o->height > p->filled ? y + o->height : p->filled;
    o->x = x;
    o->y = y;
}

static unsigned class_of(uint32_t side)
{
    unsigned octave = 31u - (unsigned)__builtin_clz(side);
    const unsigned half = octave > 0 && (side & (1u << (octave - 1))) != 0;
    octave = 2 * octave + half;
    return octave < CLASSES ? octave : CLASSES - 1;
}

/* Places an island. Returns false if there is no room, or no memory (then *status is set). */
static bool place(struct packer *p, struct kiln_island *o, int *status, struct kiln_error *error)
{
    uint32_t *cursor = &p->cursor[class_of(o->width)][class_of(o->height)], x;
    if (o->width > p->side || o->height > p->side)
        return false;
    *status = kiln_arena_grow(&p->arena, &p->by_length, &p->by_length_capacity, o->run_count, sizeof *p->by_length,
                              "an island", error);
    if (*status != KILN_OK)
        return false;
    memcpy(p->by_length, o->runs, o->run_count * sizeof *o->runs);
    qsort(p->by_length, o->run_count, sizeof *p->by_length, compare_runs);
    for (uint32_t y = *cursor; y + o->height <= p->side; y++)
        if (find_column(p, o, y, &x)) {
            take_place(p, o, x, y);
            *cursor = y;
            return true;
        }
    return false;
}

static int compare_islands(const void *a, const void *b)
{
    const struct kiln_island *p = *(const struct kiln_island *const *)a, *q = *(const struct kiln_island *const *)b;
    const uint32_t m = p->width > p->height ? p->width : p->height, n = q->width > q->height ? q->width : q->height;
    if (m != n)
        return m > n ? -1 : 1;
    if (p->texels != q->texels)
        return p->texels > q->texels ? -1 : 1;
    return p < q ? -1 : p > q;
}

/* The groups chosen for one page. Of the remaining groups, the largest first, it takes as many as fill the fraction
 * `target` of a page (at least one). `order` has their islands, the largest first; `chosen` marks the groups. */
struct choice {
    const struct kiln_islands *islands;
    struct group {
        size_t first, count;
        uint64_t texels;
        bool done, chosen;
    } * groups;
    uint32_t *by_size; /* groups, largest first */
    size_t group_count;
    struct kiln_island **order;
    size_t chosen_groups, chosen_islands;
};

static void choose(struct choice *c, double room)
{
    double sum = 0.0;
    c->chosen_groups = c->chosen_islands = 0;
    for (size_t i = 0; i < c->group_count; i++) {
        struct group *g = &c->groups[c->by_size[i]];
        g->chosen = !g->done && (c->chosen_groups == 0 || sum + (double)g->texels <= room);
        if (!g->chosen)
            continue;
        sum += (double)g->texels;
        c->chosen_groups++;
        for (size_t k = 0; k < g->count; k++)
            c->order[c->chosen_islands++] = &c->islands->islands[g->first + k];
    }
    qsort(c->order, c->chosen_islands, sizeof *c->order, compare_islands);
}

/* Tries to put all chosen islands on an empty page. */
static bool try_page(struct packer *p, const struct choice *c, uint32_t page, int *status, struct kiln_error *error)
{
    memset(p->cells.words, 0, p->cells.stride * p->cells.height * sizeof *p->cells.words);
    memset(p->cursor, 0, sizeof p->cursor);
    p->filled = 0;
    for (size_t i = 0; i < c->chosen_islands; i++) {
        if (!place(p, c->order[i], status, error))
            return false;
        c->order[i]->page = page;
    }
    return true;
}

/* Fills one page as well as possible. First tries groups that fill nearly all of it, then fewer and fewer. */
static int fill_page(struct packer *p, struct choice *c, uint32_t page, uint32_t *misfit, struct kiln_error *error)
{
    static const double first = 0.97, step = 0.03;
    const double texels = (double)p->side * p->side;
    int status = KILN_OK;
    size_t before = SIZE_MAX;
    for (double target = first; status == KILN_OK; target -= step) {
        choose(c, target * texels);
        if (c->chosen_islands == before)
            continue; /* the same choice would fail again */
        before = c->chosen_islands;
        if (try_page(p, c, page, &status, error))
            break;
        if (status == KILN_OK && c->chosen_groups == 1) {
            *misfit = c->order[0]->group;
            return KILN_BAD_INPUT;
        }
    }
    for (size_t i = 0; i < c->group_count && status == KILN_OK; i++)
        c->groups[i].done |= c->groups[i].chosen;
    return status;
}

static int compare_groups(const void *a, const void *b, void *context)
{
    const struct choice *c = context;
    const uint32_t m = *(const uint32_t *)a, n = *(const uint32_t *)b;
    if (c->groups[m].texels != c->groups[n].texels)
        return c->groups[m].texels > c->groups[n].texels ? -1 : 1;
    return m < n ? -1 : m > n;
}

static int make_choice(struct choice *c, const struct kiln_islands *islands, struct kiln_error *error)
{
    c->islands = islands;
    int status;
    KILN_TRY(kiln_allocate(&c->groups, islands->count, sizeof *c->groups, "an atlas", error));
    KILN_TRY(kiln_allocate(&c->by_size, islands->count, sizeof *c->by_size, "an atlas", error));
    KILN_TRY(kiln_allocate(&c->order, islands->count, sizeof(struct kiln_island *), "an atlas", error));
    for (size_t i = 0; i < islands->count; i++) {
        const bool begins = i == 0 || islands->islands[i].group != islands->islands[i - 1].group;
        if (begins) {
            c->by_size[c->group_count] = (uint32_t)c->group_count;
            c->groups[c->group_count++].first = i;
        }
        c->groups[c->group_count - 1].count++;
        c->groups[c->group_count - 1].texels += islands->islands[i].texels;
    }
    qsort_r(c->by_size, c->group_count, sizeof *c->by_size, compare_groups, c);
end:
    return status;
}

static bool any_left(const struct choice *c)
{
    for (size_t i = 0; i < c->group_count; i++)
        if (!c->groups[i].done)
            return true;
    return false;
}

int kiln_atlas_pack(struct kiln_islands *islands, uint32_t side, uint32_t *page_count, uint32_t *group,
                    struct kiln_error *error)
{
    struct packer p = {.side = side, .words = (side + 63) / 64};
    struct choice c = {0};
    int status = make_choice(&c, islands, error);
    if (status == KILN_OK)
        status = kiln_bitmap_reset(&p.cells, side, side, error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&p.arena, &p.window, p.words, sizeof *p.window, "a row of a page", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&p.arena, &p.blocked, p.words, sizeof *p.blocked, "a row of a page", error);
    *page_count = 0;
    while (status == KILN_OK && any_left(&c))
        status = fill_page(&p, &c, (*page_count)++, group, error);
    kiln_arena_release(&p.arena);
    kiln_free(&p.cells.words);
    kiln_free(&c.order);
    kiln_free(&c.by_size);
    kiln_free(&c.groups);
    return status;
}
