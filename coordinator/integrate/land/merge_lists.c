#include "coordinator/integrate/land/merge_lists.h"

#include <string.h>

#include "worker/base/memory.h"

int kiln_merge_lists_create(struct kiln_merge_lists *lists, size_t points, size_t words, struct kiln_error *error)
{
    *lists =
        (struct kiln_merge_lists){.chunks = (points + KILN_MERGE_CHUNK - 1) / KILN_MERGE_CHUNK, .left = (int64_t)words};
    return kiln_allocate(&lists->of, lists->chunks, sizeof *lists->of, "the points nearby", error);
}

void kiln_merge_lists_release(struct kiln_merge_lists *lists)
{
    for (size_t c = 0; lists->of != NULL && c < lists->chunks; c++)
        kiln_free(&lists->of[c]);
    kiln_free(&lists->of);
}

int kiln_merge_lists_add(struct kiln_merge_listing *listing, const uint64_t *words, size_t count,
                         struct kiln_error *error)
{
    const size_t before = listing->count == 0 ? 1 : listing->count;
    const int status =
        kiln_grow(&listing->words, &listing->room, before + count, sizeof *listing->words, "the points nearby", error);
    if (status != KILN_OK)
        return status;
    memcpy(listing->words + before, words, count * sizeof *words);
    listing->count = before + count;
    listing->words[0] = listing->count;
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
        kiln_allocate_bare(&lists->of[chunk], listing->count, sizeof *listing->words, "the points nearby", error);
    if (status == KILN_OK)
        memcpy(lists->of[chunk], listing->words, listing->count * sizeof *listing->words);
    return status;
}
