/* Stable bin sort of numbered items by several threads, in linear time: items of a bin keep their order. Not
 * collective. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_BINS_H
#define KILN_COORDINATOR_INTEGRATE_LAND_BINS_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Zero before the first sort. */
struct kiln_bins {
    uint32_t *order; /* numbers by bin: those of bin b are order[begin[b]] .. order[begin[b + 1] - 1] */
    uint32_t *begin;
    uint32_t *starts; /* for each part of the items: its count in each bin, then its write positions */
    size_t order_room, begin_room, start_room;
};

/* Sorts the numbers 0 .. count - 1, 2^32 - 1 of them at most, by `bin_of`, each less than `bins`. KILN_SYSTEM. Release
 * with kiln_bins_release, in any case. */
int kiln_bins_sort(struct kiln_bins *b, const uint32_t *bin_of, size_t count, size_t bins, uint32_t threads,
                   struct kiln_error *error);
void kiln_bins_release(struct kiln_bins *b);

#endif
