#include "coordinator/layout/raster.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"

int kiln_bitmap_reset(struct kiln_bitmap *bitmap, uint32_t width, uint32_t height, struct kiln_error *error)
{
    bitmap->width = width;
    bitmap->height = 0;
    bitmap->stride = ((size_t)width + 63) / 64;
    return kiln_bitmap_extend(bitmap, height, error);
}

int kiln_bitmap_extend(struct kiln_bitmap *bitmap, uint32_t height, struct kiln_error *error)
{
    if (height <= bitmap->height)
        return KILN_OK;
    const size_t old = bitmap->stride * bitmap->height, needed = bitmap->stride * height;
    const int status =
        kiln_grow(&bitmap->words, &bitmap->capacity, needed, sizeof *bitmap->words, "a layout's bitmap", error);
    if (status != KILN_OK)
        return status;
    memset(bitmap->words + old, 0, (needed - old) * sizeof *bitmap->words);
    bitmap->height = height;
    return KILN_OK;
}

uint32_t kiln_bitmap_set_run(struct kiln_bitmap *bitmap, uint32_t y, uint32_t first, uint32_t end)
{
    uint64_t *row = bitmap->words + (size_t)y * bitmap->stride;
    uint32_t before = 0;
    while (first < end) {
        const uint32_t bit = first % 64, count = end - first < 64 - bit ? end - first : 64 - bit;
        const uint64_t mask = (count == 64 ? UINT64_MAX : (1ull << count) - 1) << bit;
        before += (uint32_t)__builtin_popcountll(row[first / 64] & mask);
        row[first / 64] |= mask;
        first += count;
    }
    return before;
}

static double clamped(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

/* Returns the x at which the edge crosses a horizontal line, with the same bits for both directions of the edge. */
static double edge_at(const double a[2], const double b[2], double y)
{
    const double *low = a[1] < b[1] ? a : b, *high = a[1] < b[1] ? b : a;
    return low[0] + (y - low[1]) * ((high[0] - low[0]) / (high[1] - low[1]));
}

void kiln_raster_samples(struct kiln_bitmap *bitmap, const double corner[3][2], uint64_t *covered, uint64_t *again)
{
    const double low = fmin(corner[0][1], fmin(corner[1][1], corner[2][1]));
    const double high = fmax(corner[0][1], fmax(corner[1][1], corner[2][1]));
    const uint32_t first = (uint32_t)clamped(ceil(low - 0.5), 0.0, bitmap->height);
    const uint32_t end = (uint32_t)clamped(ceil(high - 0.5), 0.0, bitmap->height);
    for (uint32_t y = first; y < end; y++) {
        const double line = (double)y + 0.5;
        double left = INFINITY, right = -INFINITY;
        for (int k = 0; k < 3; k++) {
            const double *a = corner[k], *b = corner[(k + 1) % 3];
            if ((a[1] <= line) == (b[1] <= line))
                continue;
            const double x = edge_at(a, b, line);
            left = fmin(left, x);
            right = fmax(right, x);
        }
        if (!(left < right))
            continue;
        const uint32_t x0 = (uint32_t)clamped(ceil(left - 0.5), 0.0, bitmap->width);
        const uint32_t x1 = (uint32_t)clamped(ceil(right - 0.5), 0.0, bitmap->width);
        if (x0 < x1) {
            *covered += x1 - x0;
            *again += kiln_bitmap_set_run(bitmap, y, x0, x1);
        }
    }
}

/* The extent along x of the part of the triangle between two horizontal lines. It is convex: its extent is that of its
 * corners. left > right: the triangle has no such part. */
static void extent_between(const double corner[3][2], const double lines[2], double *left, double *right)
{
    *left = INFINITY;
    *right = -INFINITY;
    for (int k = 0; k < 3; k++) {
        const double *a = corner[k], *b = corner[(k + 1) % 3];
        if (a[1] >= lines[0] && a[1] <= lines[1]) {
            *left = fmin(*left, a[0]);
            *right = fmax(*right, a[0]);
        }
        for (int i = 0; i < 2; i++) {
            if ((a[1] < lines[i]) == (b[1] < lines[i]))
                continue;
            const double x = edge_at(a, b, lines[i]);
            *left = fmin(*left, x);
            *right = fmax(*right, x);
        }
    }
}

void kiln_raster_rows(const double corner[3][2], double tolerance, uint32_t width, uint32_t height, uint32_t low,
                      uint32_t high, kiln_raster_taker *take, void *taker)
{
    const double bottom = fmin(corner[0][1], fmin(corner[1][1], corner[2][1]));
    const double top = fmax(corner[0][1], fmax(corner[1][1], corner[2][1]));
    const uint32_t first = (uint32_t)clamped(floor(bottom + tolerance), 0.0, height - 1.0);
    const uint32_t end = (uint32_t)clamped(ceil(top - tolerance), first + 1.0, height);
    for (uint32_t y = first > low ? first : low; y < end && y < high; y++) {
        double lines[2], left, right;
        lines[0] = fmax(y, bottom);
        lines[1] = fmax(lines[0], fmin(y + 1.0, top));
        extent_between(corner, lines, &left, &right);
        if (!(left <= right))
            continue;
        const uint32_t x0 = (uint32_t)clamped(floor(left + tolerance), 0.0, width - 1.0);
        take(taker, y, x0, (uint32_t)clamped(ceil(right - tolerance), x0 + 1.0, width));
    }
}

/* kiln_raster_taker for a struct kiln_bitmap */
static void set_run(void *taker, uint32_t y, uint32_t first, uint32_t end)
{
    (void)kiln_bitmap_set_run(taker, y, first, end);
}

void kiln_raster_touch(struct kiln_bitmap *bitmap, const double corner[3][2], double tolerance)
{
    kiln_raster_rows(corner, tolerance, bitmap->width, bitmap->height, 0, bitmap->height, set_run, bitmap);
}
