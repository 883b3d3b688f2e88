#include "coordinator/output/map/bands/assignment.h"

#include <stdlib.h>

#include "worker/base/memory.h"

static uint64_t texels_of(const struct kiln_lightmap *map) { return (uint64_t)map->width * map->height; }

static int compare_sizes(const void *a, const void *b, void *context)
{
    const struct kiln_lightmap *maps = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const uint64_t p = texels_of(&maps[i]), q = texels_of(&maps[j]);
    if (p != q)
        return p > q ? -1 : 1;
    return i < j ? -1 : i > j;
}

struct bin {
    uint64_t load, round_load;
    uint32_t rank, round;
};

static int lighter(const struct bin *a, const struct bin *b)
{
    return a->load != b->load ? a->load < b->load : a->rank < b->rank;
}

/* Restores a min-heap after its root has grown. */
static void sink_root(struct bin *heap, uint32_t count)
{
    for (uint32_t i = 0;;) {
        uint32_t least = i;
        for (uint32_t child = 2 * i + 1; child <= 2 * i + 2 && child < count; child++)
            if (lighter(&heap[child], &heap[least]))
                least = child;
        if (least == i)
            return;
        const struct bin swap = heap[i];
        heap[i] = heap[least];
        heap[least] = swap;
        i = least;
    }
}

/* Assigns the lightmaps that are to be divided into bands to rounds of their own, after the others. */
static void assign_bands(struct kiln_assignment *assignment, const struct kiln_lightmap *maps, const uint32_t *order,
                         uint64_t budget)
{
    uint64_t load = 0;
    assignment->own_rounds = assignment->rounds;
    for (size_t i = 0; i < assignment->count; i++) {
        const uint64_t size = texels_of(&maps[order[i]]);
        if (assignment->owner[order[i]] != KILN_IN_BANDS)
            continue;
        if (load == 0 || load + size > budget) {
            assignment->rounds++;
            load = 0;
        }
        load += size;
        assignment->round[order[i]] = assignment->rounds - 1;
    }
}

/* Marks what is to be in bands. */
static void choose_bands(struct kiln_assignment *assignment, const struct kiln_lightmap *maps, uint32_t ranks,
                         uint64_t least)
{
    uint64_t total = 0;
    for (size_t i = 0; i < assignment->count; i++)
        total += maps[i].published != 0 ? texels_of(&maps[i]) : 0;
    for (size_t i = 0; i < assignment->count; i++)
        if (ranks > 1 && maps[i].published != 0 && texels_of(&maps[i]) >= least &&
            4.0 * (double)texels_of(&maps[i]) * ranks > (double)total)
            assignment->owner[i] = KILN_IN_BANDS;
}

static void assign_all(struct kiln_assignment *assignment, const struct kiln_lightmap *maps, const uint32_t *order,
                       struct bin *heap, uint32_t ranks, uint64_t budget)
{
    for (uint32_t r = 0; r < ranks; r++)
        heap[r] = (struct bin){.rank = r};
    for (size_t i = 0; i < assignment->count; i++) {
        if (maps[order[i]].published == 0) {
            assignment->owner[order[i]] = assignment->round[order[i]] = KILN_NONE;
            continue;
        }
        if (assignment->owner[order[i]] == KILN_IN_BANDS)
            continue;
        const uint64_t size = texels_of(&maps[order[i]]);
        struct bin *bin = &heap[0];
        if (bin->round_load > 0 && bin->round_load + size > budget) {
            bin->round++;
            bin->round_load = 0;
        }
        bin->load += size;
        bin->round_load += size;
        assignment->owner[order[i]] = bin->rank;
        assignment->round[order[i]] = bin->round;
        if (bin->round >= assignment->rounds)
            assignment->rounds = bin->round + 1;
        sink_root(heap, ranks);
    }
}

int kiln_assignment_create(struct kiln_assignment **assignment, const struct kiln_lightmap *lightmaps, size_t count,
                           uint32_t ranks, uint64_t texel_budget, uint64_t least_in_bands, struct kiln_error *error)
{
    uint32_t *order = NULL;
    struct bin *heap = NULL;
    int status = kiln_allocate(assignment, 1, sizeof **assignment, "the assignment of lightmaps to ranks", error);
    if (status != KILN_OK)
        return status;
    (*assignment)->count = count;
    KILN_TRY(
        kiln_allocate(&(*assignment)->owner, count, sizeof(uint32_t), "the assignment of lightmaps to ranks", error));
    KILN_TRY(
        kiln_allocate(&(*assignment)->round, count, sizeof(uint32_t), "the assignment of lightmaps to ranks", error));
    KILN_TRY(kiln_allocate(&order, count, sizeof *order, "the assignment of lightmaps to ranks", error));
    KILN_TRY(kiln_allocate(&heap, ranks, sizeof *heap, "the assignment of lightmaps to ranks", error));
    for (size_t i = 0; i < count; i++)
        order[i] = (uint32_t)i;
    qsort_r(order, count, sizeof *order, compare_sizes, (void *)(uintptr_t)lightmaps);
    choose_bands(*assignment, lightmaps, ranks, least_in_bands);
    assign_all(*assignment, lightmaps, order, heap, ranks, texel_budget);
    assign_bands(*assignment, lightmaps, order, texel_budget * ranks);
end:
    kiln_free(&order);
    kiln_free(&heap);
    if (status != KILN_OK)
        kiln_assignment_destroy(assignment);
    return status;
}

void kiln_assignment_destroy(struct kiln_assignment **assignment)
{
    if (*assignment == NULL)
        return;
    kiln_free(&(*assignment)->owner);
    kiln_free(&(*assignment)->round);
    kiln_free(assignment);
}
