/* Visibility cache of the patches pass: keeps, from step to step, which pairs of a surface point and a node see each
 * other. This never changes (Kahl, "RTX Radiosity", 2023, section 5.2), so later steps trace only unknown pairs. The
 * light is the same bit for bit.
 *
 * The cache is a matrix. Rows are the points of this process's tile runs; columns are numbers of nodes' points
 * (kiln_patch.number), in groups of 64. A tile run and a group form a tile pair. Its pairs that face each other are all
 * open (visible), all shut (occluded), or have a bit each. With bits, every point of the tile run has 64, so that a
 * pair is found by a 64-bit index in the tile run's own memory. Partly transparent pairs are not kept.
 *
 * Memory is divided among tile runs by their number of points. Tile pairs that do not fit are traced in each step. So
 * the kept pairs do not depend on the order of work. A tile run that another process computed is kept once this one
 * computes it.
 *
 * A device has such a cache in its own memory (worker/backend/vulkan/visibility.h). This struct then only tells the
 * device its memory limit and outdated entries, and receives its counts. */
#ifndef KILN_WORKER_PASS_VISIBILITY_CACHE_H
#define KILN_WORKER_PASS_VISIBILITY_CACHE_H

#include "worker/pass/patches.h"
#include "worker/scene/surface.h"

struct kiln_visibility_cache;

/* Counts of the cache, in this process since it was made. */
struct kiln_visibility_counts {
    uint64_t bytes;                      /* of memory, now */
    uint64_t asked, answered;            /* pairs that face each other; known ones among them */
    uint64_t open, shut, mixed, unknown; /* tile pairs with facing pairs, by present state */
};

/* Working set of a thread while it computes a tile run. Zero: there is no cache; all pairs are unknown. */
struct kiln_visibility_work {
    uint64_t groups;    /* 0: there is no cache */
    uint64_t *known;    /* by group, a bit a column: the column's pairs are known */
    uint64_t *open;     /* by group and point of the tile run, a bit a column: open */
    uint64_t *partial;  /* by group, a bit a column: some pair is partly open */
    uint8_t *found;     /* by group: bits of enum kiln_pairs found so far */
    uint64_t new_pairs; /* that were noted */
    uint64_t asked, answered;
};

enum kiln_pairs { KILN_PAIRS_UNKNOWN = 0, KILN_PAIRS_OPEN = 1, KILN_PAIRS_SHUT = 2, KILN_PAIRS_PARTIAL = 4 };

/* Looks up a pair that face each other: the point at `place` of the tile run, and the node with this number. */
static inline enum kiln_pairs kiln_visibility_look(struct kiln_visibility_work *w, uint32_t place, uint32_t number)
{
    const uint64_t group = number / 64, bit = (uint64_t)1 << number % 64;
    w->asked++;
    if (w->groups == 0 || (w->known[group] & bit) == 0)
        return KILN_PAIRS_UNKNOWN;
    w->answered++;
    return (w->open[64 * group + place] & bit) != 0 ? KILN_PAIRS_OPEN : KILN_PAIRS_SHUT;
}

/* Records the traced visibility of an unknown pair. */
static inline void kiln_visibility_note(struct kiln_visibility_work *w, uint32_t place, uint32_t number,
                                        enum kiln_pairs pair)
{
    const uint64_t group = number / 64, bit = (uint64_t)1 << number % 64;
    if (w->groups == 0)
        return;
    w->new_pairs++;
    w->found[group] |= (uint8_t)pair;
    if (pair == KILN_PAIRS_OPEN)
        w->open[64 * group + place] |= bit;
    else if (pair == KILN_PAIRS_PARTIAL)
        w->partial[group] |= bit;
}

/* Creates a cache of at most `bytes` bytes, for nodes with numbers below `points`. KILN_SYSTEM. Not collective. */
int kiln_visibility_cache_create(struct kiln_visibility_cache **cache, uint64_t bytes, uint64_t points,
                                 struct kiln_error *error);
/* NULL is accepted. */
void kiln_visibility_cache_destroy(struct kiln_visibility_cache **cache);
/* Upper bound of the memory of a cache of `most` bytes, in a process that owns `own` of the surface's `points` points.
 */
uint64_t kiln_visibility_cache_bytes(uint64_t most, uint64_t own, uint64_t points);

/* Call before a step, with its nodes. Drops entries of points that the surface no longer owns, and of nodes whose
 * centre or normal has changed, since they may face others. KILN_SYSTEM. */
int kiln_visibility_cache_begin(struct kiln_visibility_cache *cache, const struct kiln_surface *surface,
                                const struct kiln_patch_node *nodes, uint64_t count, struct kiln_error *error);
struct kiln_visibility_counts kiln_visibility_cache_count(const struct kiln_visibility_cache *cache);

/* ---- cache on a device ---- */

/* Data of a step for a device's cache. Borrowed until the next step. */
struct kiln_visibility_of_step {
    uint64_t most;           /* bytes */
    uint64_t groups;         /* of columns */
    uint64_t moved;          /* changes if the points change: all entries are then invalid */
    uint64_t step;           /* number, one more than the step before; `same` compares these two */
    const uint64_t *same;    /* by group, a bit a column: 0: its entries are invalid */
    const uint64_t *columns; /* by group, a bit a column: numbers of the step's nodes */
};

struct kiln_visibility_of_step kiln_visibility_cache_of_step(const struct kiln_visibility_cache *cache);
/* Receives a device's counts: `asked` and `answered` are added up, the others replaced. All 0: the device keeps
 * nothing. */
void kiln_visibility_cache_tell(struct kiln_visibility_cache *cache, const struct kiln_visibility_counts *counts);
/* Upper bound of a device's memory for its cache, bytes; arguments as kiln_visibility_cache_bytes. */
uint64_t kiln_visibility_device_bytes(uint64_t most, uint64_t own, uint64_t points);

/* 32-bit words of a tile pair on a device, besides its bits: known columns, partial columns, the index of its bits, the
 * state found. */
#define KILN_VISIBILITY_DEVICE_WORDS 6u

/* ---- cache in this process's memory ---- */

/* Creates a thread's working set. `cache` NULL: an empty one, all pairs unknown. KILN_SYSTEM. */
int kiln_visibility_work_create(struct kiln_visibility_work *work, const struct kiln_visibility_cache *cache,
                                struct kiln_error *error);
void kiln_visibility_work_release(struct kiln_visibility_work *work);

/* Call before and after computing a tile run, whose points in `places` (a bit each) are computed with all nodes of the
 * step. Thread-safe for different tile runs. `cache` NULL: nothing is known or kept. */
void kiln_visibility_open(struct kiln_visibility_work *work, const struct kiln_visibility_cache *cache,
                          const struct kiln_tile_run *run, uint64_t places);
void kiln_visibility_close(struct kiln_visibility_work *work, struct kiln_visibility_cache *cache,
                           const struct kiln_tile_run *run, uint64_t places);

#endif
