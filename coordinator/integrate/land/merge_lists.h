/* Lists of the points near each of a rank's points, for passes over all of them that use the same radius (merge.h): a
 * search costs as much as several passes. Not collective. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_MERGE_LISTS_H
#define KILN_COORDINATOR_INTEGRATE_LAND_MERGE_LISTS_H

#include "coordinator/integrate/land/merge_near.h"

enum { KILN_MERGE_CHUNK = 64 }; /* consecutive points of this rank that a thread looks at before it takes others */

/* Neighbours of a point, and whether each is near by half the radius. Zero before the first search. The caller frees
 * `half` and `near.of`. */
struct kiln_merge_neighbours {
    struct kiln_merge_near near;
    bool *half;
    size_t half_room;
};

/* of[c]: entries of chunk c; NULL: it is not listed, since `left`, the number of entries that may still be, is used up
 * by others. */
struct kiln_merge_lists {
    uint32_t **of;
    size_t chunks;
    int64_t left;
};

/* Entries of a chunk that is being listed: for each point that takes part the number of its neighbours, then these.
 * Zero at first. The caller frees `entries`. */
struct kiln_merge_listing {
    uint32_t *entries;
    size_t count, room;
};

/* Creates lists of nothing, for `own` points whose neighbours are among `all`. KILN_SYSTEM. Release in any case. */
int kiln_merge_lists_create(struct kiln_merge_lists *lists, size_t own, size_t all, struct kiln_error *error);
void kiln_merge_lists_release(struct kiln_merge_lists *lists);

/* Whether another chunk may be listed. Thread-safe, as is kiln_merge_lists_keep for different chunks. */
bool kiln_merge_lists_have_room(const struct kiln_merge_lists *lists);
/* Adds the neighbours of the chunk's next point to a listing. KILN_SYSTEM. */
int kiln_merge_lists_add(struct kiln_merge_listing *listing, const struct kiln_merge_neighbours *neighbours,
                         struct kiln_error *error);
/* Keeps the entries of a chunk, if there is room. KILN_SYSTEM. */
int kiln_merge_lists_keep(struct kiln_merge_lists *lists, size_t chunk, const struct kiln_merge_listing *listing,
                          struct kiln_error *error);
/* Reads the neighbours of a point from its entry. Returns the entry of the next; NULL without memory. */
const uint32_t *kiln_merge_lists_read(const uint32_t *entry, struct kiln_merge_neighbours *neighbours,
                                      struct kiln_error *error);

#endif
