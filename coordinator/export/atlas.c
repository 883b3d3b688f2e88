#include "coordinator/export/atlas.h"

#include <stdlib.h>
#include <string.h>

#include "coordinator/layout/raster.h"
#include "worker/base/memory.h"

enum { CLASSES = 24 }; /* of size: half octaves of the longer side, up to 2^12 and all beyond */

/* ---- outlines ---- */

static bool near_wanted(const uint8_t *wanted, int64_t width, int64_t height, int64_t x, int64_t y)
{
    for (int64_t v = y - 1; v <= y + 1; v++)
        for (int64_t u = x - 1; u <= x + 1; u++)
            if (v >= 0 && v < height && u >= 0 && u < width && wanted[v * width + u] != 0)
                return true;
    return false;
}

static int add_run(struct kiln_outline *o, int64_t row, int64_t first, int64_t end, struct kiln_error *error)
{
    const int status = kiln_grow(&o->runs, &o->run_capacity, o->run_count + 1, sizeof *o->runs, "an outline", error);
    if (status == KILN_OK)
        o->runs[o->run_count++] = (struct kiln_outline_run){(uint32_t)row, (uint32_t)first, (uint32_t)end};
    return status;
}

/* Moves the corner to the smallest box; counts. Runs were made from (-1, -1). */
static void trim(struct kiln_outline *o)
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

int kiln_outline_make(struct kiln_outline *outline, const uint8_t *wanted, uint32_t width, uint32_t height, struct kiln_error *error)
{
    *outline = (struct kiln_outline){0};
    int status = KILN_OK;
    for (int64_t y = -1; y <= (int64_t)height && status == KILN_OK; y++)
        for (int64_t x = -1; x <= (int64_t)width && status == KILN_OK; x++) {
            const int64_t first = x;
            while (x <= (int64_t)width && near_wanted(wanted, width, height, x, y))
                x++;
            if (x > first)
                status = add_run(outline, y + 1, first + 1, x + 1, error);
        }
    if (status == KILN_OK && outline->run_count == 0)
        status = add_run(outline, 1, 1, 2, error);
    if (status == KILN_OK)
        trim(outline);
    return status;
}

/* ---- packing ---- */

struct page {
    struct kiln_bitmap cells; /* set: taken */
    uint32_t filled;          /* rows from here on are empty */
};

struct packer {
    uint32_t side;
    size_t words;
    struct page *pages;
    size_t page_count, page_capacity;
    uint64_t *window, *blocked;                         /* a row */
    struct kiln_outline_run *by_length;                 /* of the outline under way */
    size_t by_length_capacity;
    struct { uint32_t page, row; } cursor[CLASSES][CLASSES]; /* where the last outline of like size went: the search begins there */
};

/* target(x) |= in(x + by). May be the same row. */
static void or_shifted(uint64_t *target, const uint64_t *in, size_t words, uint32_t by)
{
    const size_t whole = by / 64;
    const uint32_t part = by % 64;
    for (size_t i = 0; i + whole < words; i++) {
        const uint64_t low = in[i + whole], high = part != 0 && i + whole + 1 < words ? in[i + whole + 1] : 0;
        target[i] |= part == 0 ? low : low >> part | high << (64 - part);
    }
}

/* window(x) = whether any of row(x) .. row(x + length - 1) is set, by doubling. */
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

/* Columns in which the outline may not begin: all but 0 .. last. */
static void begin_blocked(struct packer *p, uint32_t last)
{
    for (size_t i = 0; i < p->words; i++) {
        const uint64_t from = 64 * (uint64_t)i;
        p->blocked[i] = from > last ? ~0ull : last - from >= 63 ? 0 : ~0ull << (last - from + 1);
    }
}

/* The first free column for the outline with its corner in row y; false: none. */
static bool find_column(struct packer *p, const struct page *page, const struct kiln_outline *o, uint32_t y, uint32_t *x)
{
    begin_blocked(p, p->side - o->width);
    for (size_t i = 0; i < o->run_count; i++) {
        const struct kiln_outline_run *run = &p->by_length[i];
        if (y + run->row >= page->filled)
            continue;
        slide(p, page->cells.words + (size_t)(y + run->row) * page->cells.stride, run->end - run->first);
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

/* Long runs first: they rule out most columns. Equal ones by place, so that the order is one. */
static int compare_runs(const void *a, const void *b)
{
    const struct kiln_outline_run *p = a, *q = b;
    const uint32_t m = p->end - p->first, n = q->end - q->first;
    if (m != n)
        return m > n ? -1 : 1;
    return p->row != q->row ? (p->row < q->row ? -1 : 1) : p->first < q->first ? -1 : p->first > q->first;
}

static void take_place(struct packer *p, struct kiln_outline *o, uint32_t page, uint32_t x, uint32_t y)
{
    struct page *target = &p->pages[page];
    for (size_t i = 0; i < o->run_count; i++)
        (void)kiln_bitmap_set_run(&target->cells, y + o->runs[i].row, x + o->runs[i].first, x + o->runs[i].end);
    target->filled = y + o->height > target->filled ? y + o->height : target->filled;
    o->page = page;
    o->x = x;
    o->y = y;
}

static int add_page(struct packer *p, struct kiln_error *error)
{
    int status = kiln_grow(&p->pages, &p->page_capacity, p->page_count + 1, sizeof *p->pages, "pages", error);
    if (status != KILN_OK)
        return status;
    p->pages[p->page_count] = (struct page){0};
    status = kiln_bitmap_reset(&p->pages[p->page_count].cells, p->side, p->side, error);
    p->page_count++;
    return status;
}

static unsigned class_of(uint32_t side)
{
    unsigned octave = 31u - (unsigned)__builtin_clz(side);
    const unsigned half = octave > 0 && (side & (1u << (octave - 1))) != 0;
    octave = 2 * octave + half;
    return octave < CLASSES ? octave : CLASSES - 1;
}

static int place(struct packer *p, struct kiln_outline *o, struct kiln_error *error)
{
    const unsigned c = class_of(o->width), r = class_of(o->height);
    int status = kiln_grow(&p->by_length, &p->by_length_capacity, o->run_count, sizeof *p->by_length, "an outline", error);
    if (status != KILN_OK)
        return status;
    memcpy(p->by_length, o->runs, o->run_count * sizeof *o->runs);
    qsort(p->by_length, o->run_count, sizeof *p->by_length, compare_runs);
    uint32_t page = p->cursor[c][r].page, y = p->cursor[c][r].row, x;
    for (;; page++, y = 0) {
        if (page == p->page_count && (status = add_page(p, error)) != KILN_OK)
            return status;
        for (; y + o->height <= p->side; y++)
            if (find_column(p, &p->pages[page], o, y, &x)) {
                take_place(p, o, page, x, y);
                p->cursor[c][r].page = page;
                p->cursor[c][r].row = y;
                return KILN_OK;
            }
    }
}

static int compare_outlines(const void *a, const void *b)
{
    const struct kiln_outline *p = *(const struct kiln_outline *const *)a, *q = *(const struct kiln_outline *const *)b;
    const uint32_t m = p->width > p->height ? p->width : p->height, n = q->width > q->height ? q->width : q->height;
    if (m != n)
        return m > n ? -1 : 1;
    if (p->texels != q->texels)
        return p->texels > q->texels ? -1 : 1;
    return p < q ? -1 : p > q;
}

int kiln_atlas_pack(struct kiln_outline *outlines, size_t count, uint32_t side, uint32_t *page_count, struct kiln_error *error)
{
    struct packer p = {.side = side, .words = (side + 63) / 64};
    struct kiln_outline **order = NULL;
    size_t used = 0;
    int status = kiln_allocate(&order, count, sizeof(struct kiln_outline *), "outlines", error);
    if (status == KILN_OK)
        status = kiln_allocate(&p.window, p.words, sizeof *p.window, "a row of a page", error);
    if (status == KILN_OK)
        status = kiln_allocate(&p.blocked, p.words, sizeof *p.blocked, "a row of a page", error);
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        if (outlines[i].run_count > 0)
            order[used++] = &outlines[i];
    if (status == KILN_OK)
        qsort(order, used, sizeof *order, compare_outlines);
    for (size_t i = 0; i < used && status == KILN_OK; i++)
        status = place(&p, order[i], error);
    *page_count = (uint32_t)p.page_count;
    for (size_t i = 0; i < p.page_count; i++)
        kiln_free(&p.pages[i].cells.words);
    kiln_free(&p.pages);
    kiln_free(&p.by_length);
    kiln_free(&p.blocked);
    kiln_free(&p.window);
    kiln_free(&order);
    return status;
}
