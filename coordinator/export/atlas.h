/* Packs lightmaps into square pages, island by island. Private to coordinator/export. Deterministic, not collective.
 *
 * An island is a part of a layout that no bilinear filter mixes with another part: covered texels less than three
 * apart, and the texels next to them. Islands are moved by whole texels and never rotated or scaled, so a filter reads
 * the same values at the same fractions. They are placed bottom-left, first fit, largest first, by their exact
 * outlines. All islands of a group are on one page. */
#ifndef KILN_COORDINATOR_EXPORT_ATLAS_H
#define KILN_COORDINATOR_EXPORT_ATLAS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* A run of texels, first .. end-1 of a row, relative to the island's corner. */
struct kiln_island_run {
    uint32_t row, first, end;
};

/* The texels that a page has to hold, as runs sorted by row and column. The corner is at (left, top) of the lightmap;
 * -1 where texels beyond its edge are needed (they repeat the edge). */
struct kiln_island {
    uint32_t group;
    int32_t left, top;
    uint32_t width, height;
    struct kiln_island_run *runs;
    size_t run_count, run_capacity;
    uint64_t texels;
    uint32_t page, x, y; /* where the corner was placed */
};

struct kiln_islands {
    struct kiln_island *islands; /* islands of a group are consecutive; groups ascend */
    size_t count, capacity;
};

/* Appends the islands of a lightmap as group `group`, which must be greater than all before. They consist of the texels
 * with wanted[i] != 0 and their eight neighbours. With `whole` they are one island. There is at least one texel. */
int kiln_islands_add(struct kiln_islands *islands, const uint8_t *wanted, uint32_t width, uint32_t height, bool whole,
                     uint32_t group, struct kiln_error *error);
void kiln_islands_free(struct kiln_islands *islands);

/* Places each island on pages of side x side texels: sets page, x, y. Gives the number of pages. If a group does not
 * fit a page of its own, returns KILN_BAD_INPUT without a sentence and gives the group in *group. */
int kiln_atlas_pack(struct kiln_islands *islands, uint32_t side, uint32_t *page_count, uint32_t *group,
                    struct kiln_error *error);

#endif
