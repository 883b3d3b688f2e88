/* Bitmaps, and two ways to rasterise triangles into them: at sample points (to find double coverage), and
 * conservatively (all cells that a triangle touches). Coordinates are in units of bitmap cells; cell (x, y) is the
 * square [x, x+1) x [y, y+1). */
#ifndef KILN_COORDINATOR_LAYOUT_RASTER_H
#define KILN_COORDINATOR_LAYOUT_RASTER_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* A bitmap. Bit x of row y is bit x % 64 of words[y * stride + x / 64]. Zero-initialise; free `words` with
 * kiln_free. */
struct kiln_bitmap {
    uint32_t width, height;
    size_t stride;
    uint64_t *words;
    size_t capacity;
};

/* Makes the bitmap width x height, all clear. Keeps its memory from one use to the next. */
int kiln_bitmap_reset(struct kiln_bitmap *bitmap, uint32_t width, uint32_t height, struct kiln_error *error);
/* Appends clear rows until there are at least `height`. */
int kiln_bitmap_extend(struct kiln_bitmap *bitmap, uint32_t height, struct kiln_error *error);

/* Sets cells first .. end-1 of row y. Returns how many of them were set before. */
uint32_t kiln_bitmap_set_run(struct kiln_bitmap *bitmap, uint32_t y, uint32_t first, uint32_t end);

/* Sets the cells whose centre the triangle covers; parts outside the bitmap are ignored. Two triangles that have an
 * edge with the same coordinates never both cover a cell along it, nor leave one out. Adds to `covered` the number of
 * cells, and to `again` the number of those that were set before. */
void kiln_raster_samples(struct kiln_bitmap *bitmap, const double corner[3][2], uint64_t *covered, uint64_t *again);

/* Callback for the cells first .. end-1 of row y. */
typedef void kiln_raster_taker(void *taker, uint32_t y, uint32_t first, uint32_t end);

/* Passes to `take` the cells of a width x height grid that the triangle overlaps by more than `tolerance` in both
 * directions; at least one. All corners must lie inside the grid. Rows outside `low` .. `high`-1 are left out. */
void kiln_raster_rows(const double corner[3][2], double tolerance, uint32_t width, uint32_t height, uint32_t low,
                      uint32_t high, kiln_raster_taker *take, void *taker);

/* Sets the cells that kiln_raster_rows gives for the whole bitmap. */
void kiln_raster_touch(struct kiln_bitmap *bitmap, const double corner[3][2], double tolerance);

#endif
