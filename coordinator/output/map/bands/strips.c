#include "coordinator/output/map/bands/strips.h"

#include <math.h>
#include <stdlib.h>

#include "coordinator/output/exr_strips.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

static uint64_t texels_of(const struct kiln_lightmap *map) { return (uint64_t)map->width * map->height; }

static uint32_t strips_of(const struct kiln_lightmap *map) { return (map->height + KILN_EXR_ROWS - 1) / KILN_EXR_ROWS; }

/* State of the assignment. The arrays have one entry per rank. */
struct work {
    const struct kiln_lightmap *lightmaps;
    const struct kiln_assignment *assignment;
    uint32_t round, ranks;
    uint64_t least;
    uint64_t *load;  /* total work of the rank's objects */
    uint64_t *fixed; /* part of the rank's load that cannot be distributed */
    double *room;    /* packing work that the rank can still take, of its own or other objects */
    uint64_t total;
    struct kiln_arena arena;
};

static bool in_round(const struct work *w, size_t object) { return w->assignment->round[object] == w->round; }

/* Whether the rank has more than 1.25 times the mean work; with less, sending does not pay. */
static bool is_overloaded(const struct work *w, uint32_t rank) { return 4 * w->load[rank] * w->ranks > 5 * w->total; }

static bool is_divided(const struct work *w, size_t object)
{
    const struct kiln_lightmap *map = &w->lightmaps[object];
    return in_round(w, object) && texels_of(map) >= w->least && strips_of(map) > 1 &&
           is_overloaded(w, w->assignment->owner[object]);
}

static void weigh(struct work *w)
{
    for (size_t i = 0; i < w->assignment->count; i++)
        if (in_round(w, i)) {
            const uint64_t work = (KILN_FINISH_WORK + KILN_PACK_WORK) * texels_of(&w->lightmaps[i]);
            w->load[w->assignment->owner[i]] += work;
            w->total += work;
        }
    for (uint32_t r = 0; r < w->ranks; r++)
        w->fixed[r] = w->load[r];
    for (size_t i = 0; i < w->assignment->count; i++)
        if (is_divided(w, i))
            w->fixed[w->assignment->owner[i]] -= KILN_PACK_WORK * texels_of(&w->lightmaps[i]);
}

static int compare_loads(const void *a, const void *b)
{
    const uint64_t p = *(const uint64_t *)a, q = *(const uint64_t *)b;
    return (p > q) - (p < q);
}

/* The water-filling level: the load up to which the distributed work fills the ranks. It never exceeds the mean load,
 * since every rank ends at this level or above. */
static double find_level(const struct work *w, uint64_t *sorted)
{
    uint64_t divided = w->total;
    for (uint32_t r = 0; r < w->ranks; r++) {
        sorted[r] = w->fixed[r];
        divided -= w->fixed[r];
    }
    qsort(sorted, w->ranks, sizeof *sorted, compare_loads);
    double below = 0.0;
    for (uint32_t r = 0; r < w->ranks; r++) {
        below += (double)sorted[r];
        const double level = (below + (double)divided) / (r + 1.0);
        if (r + 1 == w->ranks || level <= (double)sorted[r + 1])
            return level;
    }
    return 0.0;
}

static int weigh_ranks(struct work *w, struct kiln_error *error)
{
    uint64_t *sorted = NULL;
    int status;
    KILN_TRY(kiln_arena_allocate(&w->arena, &w->load, w->ranks, sizeof *w->load, "the assignment of strips", error));
    KILN_TRY(kiln_arena_allocate(&w->arena, &w->fixed, w->ranks, sizeof *w->fixed, "the assignment of strips", error));
    KILN_TRY(kiln_arena_allocate(&w->arena, &w->room, w->ranks, sizeof *w->room, "the assignment of strips", error));
    KILN_TRY(kiln_allocate(&sorted, w->ranks, sizeof *sorted, "the assignment of strips", error));
    weigh(w);
    const double level = find_level(w, sorted);
    for (uint32_t r = 0; r < w->ranks; r++)
        w->room[r] = fmax(0.0, level - (double)w->fixed[r]);
end:
    kiln_free(&sorted);
    return status;
}

/* ---- streams ---- */

static int compare_objects(const void *a, const void *b, void *context)
{
    const struct work *w = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b, p = w->assignment->owner[i],
                   q = w->assignment->owner[j];
    const uint64_t m = texels_of(&w->lightmaps[i]), n = texels_of(&w->lightmaps[j]);
    if (p != q)
        return p < q ? -1 : 1;
    return m != n ? (m > n ? -1 : 1) : (i > j) - (i < j);
}

/* Lists all strips in order, without packers. */
static int list_strips(struct kiln_strip_assignment *strips, struct work *w, struct kiln_error *error)
{
    uint32_t *objects = NULL;
    size_t count = 0, divided = 0;
    for (size_t i = 0; i < w->assignment->count; i++)
        if (is_divided(w, i)) {
            divided++;
            count += strips_of(&w->lightmaps[i]);
        }
    int status;
    KILN_TRY(kiln_allocate(&objects, divided, sizeof *objects, "the assignment of strips", error));
    KILN_TRY(kiln_allocate(&strips->strips, count, sizeof *strips->strips, "the assignment of strips", error));
    for (size_t i = 0, next = 0; i < w->assignment->count; i++)
        if (is_divided(w, i))
            objects[next++] = (uint32_t)i;
    qsort_r(objects, divided, sizeof *objects, compare_objects, w);
    for (size_t i = 0; i < divided; i++)
        for (uint32_t s = 0; s < strips_of(&w->lightmaps[objects[i]]); s++)
            strips->strips[strips->count++] = (struct kiln_strip){
                .object = objects[i], .row = s * KILN_EXR_ROWS, .owner = w->assignment->owner[objects[i]]};
end:
    kiln_free(&objects);
    return status;
}

/* Position in a stream at which a packer packs a strip. A packer has one for each of its strips. */
struct turn {
    uint32_t packer;
    double place; /* position in the stream, 0 to 1 */
};

static int compare_turns(const void *a, const void *b)
{
    const struct turn *p = a, *q = b;
    if (p->place != q->place)
        return p->place < q->place ? -1 : 1;
    return (p->packer > q->packer) - (p->packer < q->packer);
}

/* Interleaves the packers: spreads the turns of each, which are listed packer by packer, evenly over the stream. */
static void take_turns(struct kiln_strip *stream, size_t count, struct turn *turns)
{
    for (size_t i = 0; i < count;) {
        size_t end = i;
        while (end < count && turns[end].packer == turns[i].packer)
            end++;
        for (size_t k = i; k < end; k++)
            turns[k].place = ((double)(k - i) + 0.5) / (double)(end - i);
        i = end;
    }
    qsort(turns, count, sizeof *turns, compare_turns);
    for (size_t i = 0; i < count; i++) {
        stream[i].packer = turns[i].packer;
        stream[i].index = (uint32_t)i;
        stream[i].count = (uint32_t)count;
    }
}

static double strip_work(const struct work *w, const struct kiln_strip *strip)
{
    const struct kiln_lightmap *map = &w->lightmaps[strip->object];
    const uint32_t rows = map->height - strip->row < KILN_EXR_ROWS ? map->height - strip->row : KILN_EXR_ROWS;
    return (double)KILN_PACK_WORK * (double)rows * (double)map->width;
}

/* State of assigning strips to packers. Strips of a stream go to their owner until it has no more room, then to the
 * ranks with room, one after the other. `helper`: the present such rank; `filled`: work given to helpers so far;
 * `offered`: room of all helpers up to the present one. */
struct filling {
    uint32_t helper;
    double filled, offered;
};

static void fill_ranks(const struct work *w, const struct kiln_strip *stream, size_t count, struct filling *f,
                       struct turn *turns)
{
    double own = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double work = strip_work(w, &stream[i]);
        if (own + 0.5 * work < w->room[stream->owner]) {
            turns[i].packer = stream->owner;
            own += work;
            continue;
        }
        f->filled += work;
        while (f->filled - 0.5 * work >= f->offered && f->helper + 1 < w->ranks) {
            f->helper++;
            f->offered += is_overloaded(w, f->helper) ? 0.0 : w->room[f->helper];
        }
        /* because of rounding no rank may have room for a last strip */
        turns[i].packer = is_overloaded(w, f->helper) ? stream->owner : f->helper;
    }
}

static int choose_packers(struct kiln_strip_assignment *strips, const struct work *w, struct kiln_error *error)
{
    struct turn *turns = NULL;
    const int status = kiln_allocate(&turns, strips->count, sizeof *turns, "the assignment of strips", error);
    struct filling filling = {.offered = is_overloaded(w, 0) ? 0.0 : w->room[0]};
    for (size_t first = 0, end = 0; status == KILN_OK && first < strips->count; first = end) {
        while (end < strips->count && strips->strips[end].owner == strips->strips[first].owner)
            end++;
        fill_ranks(w, strips->strips + first, end - first, &filling, turns);
        take_turns(strips->strips + first, end - first, turns);
    }
    kiln_free(&turns);
    return status;
}

int kiln_strip_assignment_create(struct kiln_strip_assignment **strips, const struct kiln_lightmap *lightmaps,
                                 const struct kiln_assignment *assignment, uint32_t round, uint32_t ranks,
                                 uint64_t least_texels, struct kiln_error *error)
{
    struct work w = {
        .lightmaps = lightmaps, .assignment = assignment, .round = round, .ranks = ranks, .least = least_texels};
    int status;
    KILN_TRY(kiln_allocate(strips, 1, sizeof **strips, "the assignment of strips", error));
    KILN_TRY(weigh_ranks(&w, error));
    KILN_TRY(list_strips(*strips, &w, error));
    KILN_TRY(choose_packers(*strips, &w, error));
end:
    kiln_arena_release(&w.arena);
    if (status != KILN_OK)
        kiln_strip_assignment_destroy(strips);
    return status;
}

void kiln_strip_assignment_destroy(struct kiln_strip_assignment **strips)
{
    if (*strips == NULL)
        return;
    kiln_free(&(*strips)->strips);
    kiln_free(strips);
}

/* ---- queries ---- */

bool kiln_strip_assignment_has(const struct kiln_strip_assignment *strips, uint32_t object)
{
    for (size_t i = 0; i < strips->count; i++)
        if (strips->strips[i].object == object)
            return true;
    return false;
}

size_t kiln_strip_stream(const struct kiln_strip_assignment *strips, uint32_t rank, size_t *first)
{
    *first = 0;
    while (*first < strips->count && strips->strips[*first].owner != rank)
        *first += strips->strips[*first].count;
    return *first < strips->count ? strips->strips[*first].count : 0;
}

static int compare_progress(const void *a, const void *b, void *context)
{
    const struct kiln_strip *strips = context, *p = &strips[*(const size_t *)a], *q = &strips[*(const size_t *)b];
    const uint64_t m = (uint64_t)p->index * q->count, n = (uint64_t)q->index * p->count;
    return m != n ? (m < n ? -1 : 1) : (p->owner > q->owner) - (p->owner < q->owner);
}

size_t kiln_strip_list(const struct kiln_strip_assignment *strips, uint32_t rank, size_t *list)
{
    size_t count = 0;
    for (size_t i = 0; i < strips->count; i++)
        if (strips->strips[i].packer == rank && strips->strips[i].owner != rank)
            list[count++] = i;
    qsort_r(list, count, sizeof *list, compare_progress, strips->strips);
    return count;
}
