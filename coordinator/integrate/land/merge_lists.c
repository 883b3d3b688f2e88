#include "coordinator/integrate/land/merge_lists.h"

#include <string.h>

#include "coordinator/integrate/land/merge.h"
#include "worker/base/memory.h"

#define HALF ((uint32_t)1u << 31) /* of an entry: the point is within half the radius, too */

int kiln_merge_lists_create(struct kiln_merge_lists *lists, size_t own, size_t all, struct kiln_error *error)
{
    *lists = (struct kiln_merge_lists){.chunks = (own + KILN_MERGE_CHUNK - 1) / KILN_MERGE_CHUNK,
                                       .left = all < HALF ? (int64_t)(KILN_MERGE_LISTED * own) : 0};
    return kiln_allocate(&lists->of, lists->chunks, sizeof *lists->of, "the points nearby", error);
}

void kiln_merge_lists_release(struct kiln_merge_lists *lists)
{
    for (size_t c = 0; lists->of != NULL && c < lists->chunks; c++)
        kiln_free(&lists->of[c]);
    kiln_free(&lists->of);
}

int kiln_merge_lists_add(struct kiln_merge_listing *listing, const struct kiln_merge_neighbours *n,
                         struct kiln_error *error)
{
    const int status = kiln_grow(&listing->entries, &listing->room, listing->count + n->near.count + 1,
                                 sizeof *listing->entries, "the points nearby", error);
    if (status != KILN_OK)
        return status;
    listing->entries[listing->count++] = (uint32_t)n->near.count;
    for (size_t i = 0; i < n->near.count; i++)
        listing->entries[listing->count++] = (uint32_t)n->near.of[i] | (n->half[i] ? HALF : 0);
    return KILN_OK;
}

bool kiln_merge_lists_have_room(const struct kiln_merge_lists *lists)
{
    int64_t left;
#pragma omp atomic read
    left = lists->left;
    return left > 0;
}

int kiln_merge_lists_keep(struct kiln_merge_lists *lists, size_t chunk, const struct kiln_merge_listing *listing,
                          struct kiln_error *error)
{
    int64_t left;
#pragma omp atomic capture
    left = lists->left -= (int64_t)listing->count;
    if (left < 0 || listing->count == 0)
        return KILN_OK;
    const int status =
        kiln_allocate_bare(&lists->of[chunk], listing->count, sizeof *listing->entries, "the points nearby", error);
    if (status == KILN_OK)
        memcpy(lists->of[chunk], listing->entries, listing->count * sizeof *listing->entries);
    return status;
}

const uint32_t *kiln_merge_lists_read(const uint32_t *entry, struct kiln_merge_neighbours *n, struct kiln_error *error)
{
    const size_t count = *entry++;
    if (kiln_grow(&n->near.of, &n->near.room, count, sizeof *n->near.of, "points nearby", error) != KILN_OK ||
        kiln_grow(&n->half, &n->half_room, count, sizeof *n->half, "points nearby", error) != KILN_OK)
        return NULL;
    n->near.count = count;
    for (size_t i = 0; i < count; i++) {
        n->near.of[i] = entry[i] & ~HALF;
        n->half[i] = (entry[i] & HALF) != 0;
    }
    return entry + count;
}
