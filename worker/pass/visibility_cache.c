#include "worker/pass/visibility_cache.h"

#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/clock.h"
#include "worker/base/memory.h"

/* Special values of entry.at, for tile pairs without bits. */
#define NONE UINT32_MAX           /* unknown */
#define NOTHING (UINT32_MAX - 1u) /* no pair faces each other */
#define OPEN (UINT32_MAX - 2u)
#define SHUT (UINT32_MAX - 3u)
#define BITS (UINT32_MAX - 4u) /* values below: index among the tile pairs with bits */

/* Known pairs of a tile run, in one piece of memory. */
struct entry {
    uint64_t places; /* its points that were computed */
    uint64_t bytes;
    uint64_t *known; /* of each group */
    uint64_t *open;  /* per tile pair with bits and point: mask of visible points */
    uint32_t *at;    /* of each group */
};

struct ends {
    struct kiln_vec3 centre, normal;
};

struct kiln_visibility_cache {
    uint64_t most, groups;
    uint64_t first, count;  /* own points */
    struct entry **entries; /* at the index of the first point of each tile run */
    uint64_t *columns;      /* per group: mask of numbers that nodes of this step have */
    uint64_t *same;         /* per group: mask of columns unchanged since the previous step */
    uint64_t moved, step;
    struct kiln_visibility_counts on_device;
    struct ends *ends; /* by number: the node that had it last */
    struct kiln_visibility_counts counts;
    struct kiln_arena arena;
};

static uint64_t groups_of(uint64_t points) { return (points + 63) / 64; }

int kiln_visibility_cache_create(struct kiln_visibility_cache **cache, uint64_t bytes, uint64_t points,
                                 struct kiln_error *error)
{
    struct kiln_visibility_cache *c = NULL;
    int status;
    KILN_TRY(kiln_allocate(&c, 1, sizeof *c, "the visibility cache", error));
    c->most = bytes;
    c->step = (uint64_t)(kiln_clock_seconds() * 1e9); /* no two caches have one in common */
    c->groups = groups_of(points);
    KILN_TRY(kiln_arena_allocate(&c->arena, &c->columns, (size_t)c->groups, sizeof *c->columns, "the visibility cache",
                                 error));
    KILN_TRY(
        kiln_arena_allocate(&c->arena, &c->same, (size_t)c->groups, sizeof *c->same, "the visibility cache", error));
    KILN_TRY(kiln_arena_allocate(&c->arena, &c->ends, (size_t)(64 * c->groups), sizeof *c->ends, "the visibility cache",
                                 error));
end:
    if (status != KILN_OK)
        kiln_visibility_cache_destroy(&c);
    *cache = c;
    return status;
}

static void forget(struct kiln_visibility_cache *c, struct entry **entry)
{
    if (*entry == NULL)
        return;
#pragma omp atomic
    c->counts.bytes -= (*entry)->bytes;
    kiln_free(entry);
}

static void forget_all(struct kiln_visibility_cache *c)
{
    for (uint64_t i = 0; c->entries != NULL && i < c->count; i++)
        forget(c, &c->entries[i]);
    kiln_free(&c->entries);
    c->first = c->count = 0;
}

void kiln_visibility_cache_destroy(struct kiln_visibility_cache **cache)
{
    if (*cache == NULL)
        return;
    forget_all(*cache);
    kiln_arena_release(&(*cache)->arena);
    kiln_free(cache);
}

/* Bytes of an entry without its bits: known columns, and indices of tile pairs. */
static uint64_t entry_bytes(uint64_t groups, uint64_t words)
{
    return sizeof(struct entry) + groups * (sizeof(uint64_t) + sizeof(uint32_t)) + words * sizeof(uint64_t);
}

uint64_t kiln_visibility_cache_bytes(uint64_t most, uint64_t own, uint64_t points)
{
    const uint64_t groups = groups_of(points), fixed = groups * (16 + 64 * sizeof(struct ends)) + own * sizeof(void *);
    const double all = (double)own * (double)groups * 8.0 + (double)groups_of(own) * (double)entry_bytes(groups, 0);
    return fixed + (all < (double)most ? (uint64_t)all : most);
}

/* ---- kept by a device ---- */

struct kiln_visibility_of_step kiln_visibility_cache_of_step(const struct kiln_visibility_cache *c)
{
    return (struct kiln_visibility_of_step){c->most, c->groups, c->moved, c->step, c->same, c->columns};
}

void kiln_visibility_cache_tell(struct kiln_visibility_cache *c, const struct kiln_visibility_counts *counts)
{
    const uint64_t asked = c->on_device.asked + counts->asked, answered = c->on_device.answered + counts->answered;
    c->on_device = *counts;
    c->on_device.asked = asked;
    c->on_device.answered = answered;
}

uint64_t kiln_visibility_device_bytes(uint64_t most, uint64_t own, uint64_t points)
{
    const double groups = (double)groups_of(points),
                 runs = 2.0 * (double)groups_of(own), /* of half as many points as a tile has at most */
        all = groups * ((double)own * 8.0 + runs * 4.0 * KILN_VISIBILITY_DEVICE_WORDS);
    return all < (double)most ? (uint64_t)all : most;
}

/* ---- a step ---- */

static int take_points(struct kiln_visibility_cache *c, const struct kiln_surface *surface, struct kiln_error *error)
{
    if (c->entries != NULL && c->first == surface->first.at && c->count == surface->count)
        return KILN_OK;
    forget_all(c);
    c->moved++;
    c->first = surface->first.at;
    c->count = surface->count;
    return kiln_allocate(&c->entries, (size_t)c->count, sizeof *c->entries, "the visibility cache", error);
}

/* Clears known columns that are not in `same`. */
static void keep_columns(struct kiln_visibility_cache *c, const uint64_t *same)
{
    for (uint64_t i = 0; i < c->count; i++)
        for (uint64_t g = 0; c->entries[i] != NULL && g < c->groups; g++)
            c->entries[i]->known[g] &= same[g];
}

int kiln_visibility_cache_begin(struct kiln_visibility_cache *c, const struct kiln_surface *surface,
                                const struct kiln_patch_node *nodes, uint64_t count, struct kiln_error *error)
{
    uint64_t *same = c->same;
    const int status = take_points(c, surface, error);
    if (status == KILN_OK) {
        c->step++;
        memset(same, 0xff, c->groups * sizeof *same);
        memset(c->columns, 0, c->groups * sizeof *c->columns);
        for (uint64_t k = 0; k < count; k++) {
            const uint32_t number = nodes[k].patch.number;
            const struct ends ends = {nodes[k].centre, nodes[k].patch.normal};
            c->columns[number / 64] |= (uint64_t)1 << number % 64;
            if (memcmp(&c->ends[number], &ends, sizeof ends) != 0)
                same[number / 64] &= ~((uint64_t)1 << number % 64);
            c->ends[number] = ends;
        }
        keep_columns(c, same);
    }
    return status;
}

struct kiln_visibility_counts kiln_visibility_cache_count(const struct kiln_visibility_cache *c)
{
    struct kiln_visibility_counts counts = c->on_device;
    counts.bytes += c->counts.bytes;
    counts.asked += c->counts.asked;
    counts.answered += c->counts.answered;
    for (uint64_t i = 0; i < c->count; i++)
        for (uint64_t g = 0; c->entries != NULL && c->entries[i] != NULL && g < c->groups; g++) {
            const uint32_t at = c->entries[i]->at[g];
            counts.open += at == OPEN;
            counts.shut += at == SHUT;
            counts.mixed += at < BITS;
            counts.unknown += at == NONE;
        }
    return counts;
}

/* ---- a tile run ---- */

int kiln_visibility_work_create(struct kiln_visibility_work *w, const struct kiln_visibility_cache *cache,
                                struct kiln_error *error)
{
    static const char what[] = "the visibility of a tile run";
    *w = (struct kiln_visibility_work){0};
    if (cache == NULL)
        return KILN_OK;
    const size_t groups = (size_t)cache->groups;
    int status;
    KILN_TRY(kiln_allocate(&w->known, groups, sizeof *w->known, what, error));
    KILN_TRY(kiln_allocate(&w->open, 64 * groups, sizeof *w->open, what, error));
    KILN_TRY(kiln_allocate(&w->partial, groups, sizeof *w->partial, what, error));
    KILN_TRY(kiln_allocate(&w->found, groups, sizeof *w->found, what, error));
end:
    return status;
}

void kiln_visibility_work_release(struct kiln_visibility_work *w)
{
    kiln_free(&w->known);
    kiln_free(&w->open);
    kiln_free(&w->partial);
    kiln_free(&w->found);
    *w = (struct kiln_visibility_work){0};
}

/* NULL: of another process. */
static struct entry **entry_of(const struct kiln_visibility_cache *c, const struct kiln_tile_run *run)
{
    const bool own = c != NULL && run->first.at >= c->first && run->first.at - c->first < c->count;
    return own ? &c->entries[run->first.at - c->first] : NULL;
}

static void read_group(struct kiln_visibility_work *w, const struct entry *e, uint64_t g, uint32_t height)
{
    uint64_t *open = &w->open[64 * g];
    w->known[g] = e->known[g];
    if (e->at[g] < BITS) {
        memcpy(open, &e->open[(uint64_t)e->at[g] * height], height * sizeof *open);
        w->found[g] = KILN_PAIRS_OPEN | KILN_PAIRS_SHUT;
    } else if (e->at[g] == OPEN) {
        for (uint32_t i = 0; i < height; i++)
            open[i] = e->known[g];
        w->found[g] = KILN_PAIRS_OPEN;
    } else if (e->at[g] == SHUT) {
        w->found[g] = KILN_PAIRS_SHUT;
    }
    for (uint32_t i = 0; i < height; i++) /* cleared visibility is found again */
        open[i] &= e->known[g];
}

void kiln_visibility_open(struct kiln_visibility_work *w, const struct kiln_visibility_cache *cache,
                          const struct kiln_tile_run *run, uint64_t places)
{
    struct entry **entry = entry_of(cache, run);
    w->groups = entry != NULL ? cache->groups : 0;
    w->new_pairs = w->asked = w->answered = 0;
    if (entry == NULL)
        return;
    memset(w->known, 0, w->groups * sizeof *w->known);
    memset(w->open, 0, 64 * w->groups * sizeof *w->open);
    memset(w->partial, 0, w->groups * sizeof *w->partial);
    memset(w->found, 0, w->groups * sizeof *w->found);
    if (*entry != NULL && (*entry)->places == places)
        for (uint64_t g = 0; g < w->groups; g++)
            read_group(w, *entry, g, run->count);
}

static struct entry *new_entry(uint64_t groups, uint64_t words)
{
    struct entry *e = NULL;
    struct kiln_error unused;
    const uint64_t bytes = entry_bytes(groups, words);
    if (kiln_allocate(&e, (size_t)bytes, 1, "the visibility cache", &unused) != KILN_OK)
        return NULL; /* the tile run is traced again, like those without memory */
    e->bytes = bytes;
    e->known = (uint64_t *)(e + 1);
    e->open = e->known + groups;
    e->at = (uint32_t *)(e->open + words);
    return e;
}

static bool has_bits(const struct kiln_visibility_work *w, uint64_t g)
{
    return (w->found[g] & KILN_PAIRS_OPEN) != 0 && (w->found[g] & KILN_PAIRS_SHUT) != 0;
}

/* Counts the tile pairs of the tile run that may get bits; 0 if there is none, or no memory at all, when *any is false.
 */
static uint64_t room_for_bits(const struct kiln_visibility_cache *c, const struct kiln_tile_run *run, bool *any)
{
    const uint64_t share = (uint64_t)((double)c->most * run->count / (double)c->count),
                   least = entry_bytes(c->groups, 0);
    *any = share >= least;
    return *any ? (share - least) / (run->count * sizeof(uint64_t)) : 0;
}

/* Makes the tile run's entry from the visibility known now. */
static struct entry *pack(const struct kiln_visibility_work *w, const struct kiln_visibility_cache *c,
                          const struct kiln_tile_run *run)
{
    bool any;
    const uint64_t room = room_for_bits(c, run, &any);
    uint64_t wanted = 0;
    for (uint64_t g = 0; g < w->groups; g++)
        wanted += has_bits(w, g);
    const uint64_t count = wanted < room ? wanted : room;
    struct entry *e = any ? new_entry(w->groups, count * run->count) : NULL;
    uint32_t next = 0;
    for (uint64_t g = 0; e != NULL && g < w->groups; g++) {
        const uint8_t found = w->found[g];
        e->known[g] = (w->known[g] | c->columns[g]) & ~w->partial[g];
        if (!has_bits(w, g)) {
            e->at[g] = found == 0                       ? NOTHING
                       : (found & KILN_PAIRS_OPEN) != 0 ? OPEN
                       : (found & KILN_PAIRS_SHUT) != 0 ? SHUT
                                                        : NONE;
        } else if (next < count) {
            memcpy(&e->open[(uint64_t)next * run->count], &w->open[64 * g], run->count * sizeof *e->open);
            e->at[g] = next++;
        } else {
            e->at[g] = NONE;
            e->known[g] = 0;
        }
    }
    return e;
}

void kiln_visibility_close(struct kiln_visibility_work *w, struct kiln_visibility_cache *c,
                           const struct kiln_tile_run *run, uint64_t places)
{
    struct entry **entry = entry_of(c, run);
    if (entry == NULL)
        return;
#pragma omp atomic
    c->counts.asked += w->asked;
#pragma omp atomic
    c->counts.answered += w->answered;
    if (w->new_pairs == 0 && *entry != NULL && (*entry)->places == places)
        return;
    forget(c, entry);
    *entry = pack(w, c, run);
    if (*entry == NULL)
        return;
    (*entry)->places = places;
#pragma omp atomic
    c->counts.bytes += (*entry)->bytes;
}
