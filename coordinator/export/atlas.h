/* Packs outlines of any shape into square pages: bottom-left first fit, largest first. Private to coordinator/export. Deterministic. */
#ifndef KILN_COORDINATOR_EXPORT_ATLAS_H
#define KILN_COORDINATOR_EXPORT_ATLAS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Texels first .. end-1 of a row, from the outline's own corner. */
struct kiln_outline_run {
    uint32_t row, first, end;
};

/* The texels of an object that its page has to hold: runs, by row and column. The corner lies at (left, top) of the object's lightmap,
 * which is -1 where texels beyond its edge are wanted (they repeat the edge). */
struct kiln_outline {
    int32_t left, top;
    uint32_t width, height;
    struct kiln_outline_run *runs;
    size_t run_count, run_capacity;
    uint64_t texels;
    uint32_t page, x, y; /* where the corner went */
};

/* What of a lightmap is kept: texels with wanted[i] != 0 and their eight neighbours. One texel at least. Free the runs with kiln_free. */
int kiln_outline_make(struct kiln_outline *outline, const uint8_t *wanted, uint32_t width, uint32_t height, struct kiln_error *error);

/* Finds a place for each outline that has runs on pages of side x side texels, into page, x, y; none is larger than a page. Gives the number
 * of pages. */
int kiln_atlas_pack(struct kiln_outline *outlines, size_t count, uint32_t side, uint32_t *page_count, struct kiln_error *error);

#endif
