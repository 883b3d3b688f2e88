/* Lists of the points near each of a rank's points, for passes over all of them that use the same radius (merge.h): a
 * search costs as much as several passes. Not collective. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_MERGE_LISTS_H
#define KILN_COORDINATOR_INTEGRATE_LAND_MERGE_LISTS_H

#include "coordinator/integrate/land/merge_group.h"

/* of[c]: groups of chunk c; NULL: it is not listed, since `left`, the number of words that may still be kept, is used
 * up by others, or since it has none. */
struct kiln_merge_lists {
    uint64_t **of;
    size_t chunks;
    int64_t left;
};

/* Groups of a chunk that is being listed: first the number of words. Zero at first. The caller frees `words`. */
struct kiln_merge_listing {
    uint64_t *words;
    size_t count, room;
};

/* Creates lists of nothing, of `words` in all at most, for `points` points. KILN_SYSTEM. Release in any case. */
int kiln_merge_lists_create(struct kiln_merge_lists *lists, size_t points, size_t words, struct kiln_error *error);
void kiln_merge_lists_release(struct kiln_merge_lists *lists);

/* Whether another chunk may be listed. Thread-safe, as is kiln_merge_lists_keep for different chunks. */
bool kiln_merge_lists_have_room(const struct kiln_merge_lists *lists);
/* Adds a group of so many words to a listing. KILN_SYSTEM. */
int kiln_merge_lists_add(struct kiln_merge_listing *listing, const uint64_t *words, size_t count,
                         struct kiln_error *error);
/* Keeps the groups of a chunk, if there is room. KILN_SYSTEM. */
int kiln_merge_lists_keep(struct kiln_merge_lists *lists, size_t chunk, const struct kiln_merge_listing *listing,
                          struct kiln_error *error);

#endif
