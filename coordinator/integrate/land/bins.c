#include "coordinator/integrate/land/bins.h"

#include <string.h>

#include "worker/base/memory.h"

enum { FEW = 1 << 12 }; /* fewest items that are worth several threads */

static size_t part_begin(size_t count, size_t part, size_t parts)
{
    return count / parts * part + (part < count % parts ? part : count % parts);
}

/* Turns the number of items per bin and part into start indices. */
static void add_up_starts(struct kiln_bins *b, size_t parts, size_t bins)
{
    uint32_t next = 0;
    for (size_t bin = 0; bin < bins; bin++) {
        b->begin[bin] = next;
        for (size_t part = 0; part < parts; part++) {
            const uint32_t count = b->starts[part * bins + bin];
            b->starts[part * bins + bin] = next;
            next += count;
        }
    }
    b->begin[bins] = next;
}

int kiln_bins_sort(struct kiln_bins *b, const uint32_t *bin_of, size_t count, size_t bins, uint32_t threads,
                   struct kiln_error *error)
{
    const size_t parts = threads > 1 && count > FEW ? threads : 1;
    int status = kiln_grow(&b->order, &b->order_room, count, sizeof *b->order, "an order by bins", error);
    if (status == KILN_OK)
        status = kiln_grow(&b->begin, &b->begin_room, bins + 1, sizeof *b->begin, "an order by bins", error);
    if (status == KILN_OK)
        status = kiln_grow(&b->starts, &b->start_room, parts * bins, sizeof *b->starts, "an order by bins", error);
    if (status != KILN_OK)
        return status;
    uint32_t *order = b->order;
    memset(b->starts, 0, parts * bins * sizeof *b->starts);
#pragma omp parallel for num_threads((int)parts) schedule(static, 1)
    for (size_t part = 0; part < parts; part++) {
        uint32_t *counts = b->starts + part * bins;
        for (size_t i = part_begin(count, part, parts); i < part_begin(count, part + 1, parts); i++)
            counts[bin_of[i]]++;
    }
    add_up_starts(b, parts, bins);
#pragma omp parallel for num_threads((int)parts) schedule(static, 1)
    for (size_t part = 0; part < parts; part++) {
        uint32_t *next = b->starts + part * bins;
        for (size_t i = part_begin(count, part, parts); i < part_begin(count, part + 1, parts); i++)
            order[next[bin_of[i]]++] = (uint32_t)i;
    }
    return KILN_OK;
}

void kiln_bins_release(struct kiln_bins *b)
{
    kiln_free(&b->order);
    kiln_free(&b->begin);
    kiln_free(&b->starts);
}
