/* Visibility cache of the patches pass, from a step to the later ones: which pairs of a surface point and a node see
 * each other. A pair's visibility does not change from step to step (Kahl, "RTX Radiosity", 2023, section 5.2), so a
 * later step traces only pairs that are not known. Its light is the same bit for bit.
 *
 * Rows are the points of this process's tile runs; columns are the numbers of the points that nodes stand at
 * (kiln_patch.number), in groups of 64. A tile run and a group are a tile pair: its pairs that face each other are all
 * open, all shut, or have a bit each. In a tile pair with bits every point of the tile run has 64, so that a pair is
 * found by its place: a 64-bit index, in the tile run's own memory. Pairs that surfaces let through in part are not
 * kept.
 *
 * Memory is shared out by points: a tile run has its part of the whole, and when that is used up the rest of its tile
 * pairs are traced in each step. So what is kept does not hang on the order of work. A tile run that another process
 * has computed is kept when this one computes it.
 *
 * A device keeps it likewise, in its own memory (worker/backend/vulkan/visibility.h): the cache then says what it may
 * take, and what is to be forgotten, and has its counts. */
#ifndef KILN_WORKER_PASS_VISIBILITY_CACHE_H
#define KILN_WORKER_PASS_VISIBILITY_CACHE_H

#include "worker/pass/patches.h"
#include "worker/scene/surface.h"

struct kiln_visibility_cache;

/* Counts of the cache, in this process since it was made. */
struct kiln_visibility_counts {
    uint64_t bytes;                      /* of memory, now */
    uint64_t asked, answered;            /* pairs that face each other; of these those that were known */
    uint64_t open, shut, mixed, unknown; /* tile pairs that have a pair: as they are known now */
};

/* Working set of a thread while it computes a tile run. Zero: there is no cache; all pairs are unknown. */
struct kiln_visibility_work {
    uint64_t groups;    /* 0: there is no cache */
    uint64_t *known;    /* of each group, a bit a column: its pairs are known */
    uint64_t *open;     /* of each group and point of the tile run, a bit a column */
    uint64_t *partial;  /* of each group, a bit a column: of a pair that is partly open */
    uint8_t *found;     /* of each group: KILN_PAIRS_OPEN, KILN_PAIRS_SHUT */
    uint64_t new_pairs; /* that were noted */
    uint64_t asked, answered;
};

enum kiln_pairs { KILN_PAIRS_UNKNOWN = 0, KILN_PAIRS_OPEN = 1, KILN_PAIRS_SHUT = 2, KILN_PAIRS_PARTIAL = 4 };

/* Looks up a pair that face each other: the point at `place` of the tile run, and the node at a number. */
static inline enum kiln_pairs kiln_visibility_look(struct kiln_visibility_work *w, uint32_t place, uint32_t number)
{
    const uint64_t group = number / 64, bit = (uint64_t)1 << number % 64;
    w->asked++;
    if (w->groups == 0 || (w->known[group] & bit) == 0)
        return KILN_PAIRS_UNKNOWN;
    w->answered++;
    return (w->open[64 * group + place] & bit) != 0 ? KILN_PAIRS_OPEN : KILN_PAIRS_SHUT;
}

/* Notes what was found of an unknown pair. */
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

/* A cache of so many bytes at most, for nodes with numbers below `points`. KILN_SYSTEM. Not collective. */
int kiln_visibility_cache_create(struct kiln_visibility_cache **cache, uint64_t bytes, uint64_t points,
                                 struct kiln_error *error);
/* NULL is accepted. */
void kiln_visibility_cache_destroy(struct kiln_visibility_cache **cache);
/* Bytes of memory that a cache of `most` bytes takes at most, in a process with `own` of the surface's `points`. */
uint64_t kiln_visibility_cache_bytes(uint64_t most, uint64_t own, uint64_t points);

/* Before a step, with its nodes: forgets what is of points that are no longer the surface's own, and what is of a
 * node that has another centre or normal than before, for it may face others. KILN_SYSTEM. */
int kiln_visibility_cache_begin(struct kiln_visibility_cache *cache, const struct kiln_surface *surface,
                                const struct kiln_patch_node *nodes, uint64_t count, struct kiln_error *error);
struct kiln_visibility_counts kiln_visibility_cache_count(const struct kiln_visibility_cache *cache);

/* ---- kept by a device ---- */

/* Data of a step that a device must know. Borrowed until the next step. */
struct kiln_visibility_of_step {
    uint64_t most;           /* bytes */
    uint64_t groups;         /* of columns */
    uint64_t moved;          /* another number than before: of other points; all is to be forgotten */
    uint64_t step;           /* its number, one more than that of the step before; `same` goes from that to this */
    const uint64_t *same;    /* of each group, a bit a column: 0: what is known of it is to be forgotten */
    const uint64_t *columns; /* of each group: numbers that the step's nodes have */
};

struct kiln_visibility_of_step kiln_visibility_cache_of_step(const struct kiln_visibility_cache *cache);
/* Takes a device's counts: `asked` and `answered` are added to those before, the others are as they are now. All 0: it
 * keeps nothing. */
void kiln_visibility_cache_tell(struct kiln_visibility_cache *cache, const struct kiln_visibility_counts *counts);
/* Bytes that a device takes at most. */
uint64_t kiln_visibility_device_bytes(uint64_t most, uint64_t own, uint64_t points);

/* Words of 32 bits of a tile run on a device, besides its bits, for a group of columns: known and partial columns, its
 * place among the bits, what was found. */
#define KILN_VISIBILITY_DEVICE_WORDS 6u

/* ---- kept in this process's memory ---- */

/* A thread's own. `cache` NULL: there is none. KILN_SYSTEM. */
int kiln_visibility_work_create(struct kiln_visibility_work *work, const struct kiln_visibility_cache *cache,
                                struct kiln_error *error);
void kiln_visibility_work_release(struct kiln_visibility_work *work);

/* Before and after a tile run, of whose points those of `places` (a bit each) are computed with all nodes of the step.
 * Threads may call these at the same time for different tile runs. `cache` NULL: nothing is known, nothing is kept. */
void kiln_visibility_open(struct kiln_visibility_work *work, const struct kiln_visibility_cache *cache,
                          const struct kiln_tile_run *run, uint64_t places);
void kiln_visibility_close(struct kiln_visibility_work *work, struct kiln_visibility_cache *cache,
                           const struct kiln_tile_run *run, uint64_t places);

#endif
