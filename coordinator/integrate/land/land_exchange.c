#include "coordinator/integrate/land/land_exchange.h"

#include <assert.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

_Static_assert(sizeof(struct kiln_landing_record) == 32, "a record has no gaps");

/* Size of a stretch: 2^STRETCH consecutive points, whose sums one thread adds up. Stretches are longer if there would
 * be more than STRETCHES_MOST. */
enum { STRETCH = 8, STRETCHES_MOST = 1 << 13 };
enum { FEW = 1 << 12 }; /* records that are not worth several threads */

/* ---- memory that ranks share ---- */

/* A rank's part of the shared memory. `begin`: number of its records before each stretch, with one entry more than
 * stretches; `order`: indices of records sorted by stretch; and the records. */
struct part {
    uint32_t *begin, *order;
    struct kiln_landing_record *records;
};

static struct part part_of(const struct kiln_land_exchange *e, int rank)
{
    char *at = kiln_rank_region(e->parts, rank);
    const size_t records = e->room * sizeof *e->records, order = e->room * sizeof(uint32_t);
    return (struct part){.records = (struct kiln_landing_record *)(void *)at,
                         .order = (uint32_t *)(void *)(at + records),
                         .begin = (uint32_t *)(void *)(at + records + order)};
}

/* Collective. Allocates shared room, the same for all ranks. If there is no memory to share, which the node reports,
 * records are sent by messages. */
static int share(struct kiln_land_exchange *e, struct kiln_node_memory *node, uint64_t paths, struct kiln_error *error)
{
    e->room = (size_t)(paths / (uint64_t)e->ranks) + 1;
    const uint64_t bytes =
        e->room * (sizeof *e->records + sizeof(uint32_t)) + (e->stretch[e->ranks] + 1) * sizeof(uint32_t);
    if (kiln_rank_regions_create(&e->parts, node, bytes, "the landings of light paths", NULL) != KILN_OK) {
        e->room = 0;
        return KILN_OK;
    }
    e->node = node;
    e->records = part_of(e, e->rank).records;
    return kiln_agree(
        e->communicator,
        kiln_grow(&e->bin_of, &e->bin_room, e->room, sizeof *e->bin_of, "the landings of light paths", error), error);
}

/* ---- making ---- */

/* Numbers the stretches of all ranks' points consecutively, the same on all ranks. */
static void number_stretches(struct kiln_land_exchange *e, bool shared)
{
    const uint64_t most = STRETCHES_MOST / (shared ? (uint64_t)e->ranks : 1) + 1;
    uint64_t largest = 0;
    for (int r = 0; r < e->ranks; r++)
        largest = e->first[r + 1] - e->first[r] > largest ? e->first[r + 1] - e->first[r] : largest;
    e->shift = STRETCH;
    while (largest >> e->shift >= most)
        e->shift++;
    for (int r = 0; r < e->ranks; r++)
        e->stretch[r + 1] = e->stretch[r] + ((e->first[r + 1] - e->first[r]) >> e->shift) + 1;
}

int kiln_land_exchange_create(struct kiln_land_exchange *e, MPI_Comm communicator, struct kiln_node_memory *node,
                              uint64_t first, uint64_t count, uint64_t paths, uint64_t limit, struct kiln_error *error)
{
    *e = (struct kiln_land_exchange){.communicator = communicator, .threads = 1};
    (void)MPI_Comm_rank(communicator, &e->rank);
    (void)MPI_Comm_size(communicator, &e->ranks);
    int status = kiln_exchange_create(&e->exchange, communicator, limit, "the landings of light paths", error);
    if (status == KILN_OK)
        status = kiln_allocate(&e->first, (size_t)e->ranks + 1, sizeof *e->first, "the ranks' points", error);
    if (status == KILN_OK)
        status = kiln_allocate(&e->stretch, (size_t)e->ranks + 1, sizeof *e->stretch, "the ranks' points", error);
    if (status == KILN_OK && count > UINT32_MAX)
        status = kiln_fail(error, KILN_USAGE,
                           "light paths land on %llu surface points of a rank, which may have %u at most: bake on more "
                           "ranks",
                           (unsigned long long)count, UINT32_MAX);
    status = kiln_agree(communicator, status, error);
    if (status != KILN_OK)
        return status;
    uint64_t end = first + count;
    (void)MPI_Allgather(&first, 1, MPI_UINT64_T, e->first, 1, MPI_UINT64_T, communicator);
    (void)MPI_Bcast(&end, 1, MPI_UINT64_T, e->ranks - 1, communicator);
    e->first[e->ranks] = end;
    const bool shared = e->ranks > 1 && node != NULL && kiln_node_ranks(node) == e->ranks;
    number_stretches(e, shared);
    return shared ? share(e, node, paths, error) : KILN_OK;
}

void kiln_land_exchange_release(struct kiln_land_exchange *e)
{
    if (e->parts == NULL)
        kiln_free(&e->records);
    e->records = NULL;
    kiln_rank_regions_destroy(&e->parts);
    kiln_free(&e->first);
    kiln_free(&e->stretch);
    kiln_exchange_release(&e->exchange);
    kiln_free(&e->bin_of);
    kiln_free(&e->sent);
    kiln_bins_release(&e->sorted);
}

/* ---- records of paths ---- */

int kiln_land_exchange_grow(struct kiln_land_exchange *e, size_t more, struct kiln_error *error)
{
    const size_t needed = e->count + more;
    if (e->parts != NULL) {
        assert(needed <= e->room);
        return KILN_OK;
    }
    int status = kiln_grow(&e->records, &e->room, needed, sizeof *e->records, "the landings of light paths", error);
    if (status == KILN_OK)
        status = kiln_grow(&e->bin_of, &e->bin_room, needed, sizeof *e->bin_of, "the landings of light paths", error);
    return status;
}

/* The rank that has a point. */
static uint32_t owner_of(const struct kiln_land_exchange *e, uint64_t point)
{
    uint32_t low = 0, high = (uint32_t)e->ranks; /* first[low] <= point < first[high] */
    while (high - low > 1) {
        const uint32_t middle = low + (high - low) / 2;
        *(e->first[middle] <= point ? &low : &high) = middle;
    }
    return low;
}

struct kiln_landing_record *kiln_land_exchange_put(struct kiln_land_exchange *e, size_t at, uint64_t point)
{
    const uint32_t owner = owner_of(e, point);
    struct kiln_landing_record *record = &e->records[at];
    record->point = (uint32_t)(point - e->first[owner]);
    e->bin_of[at] =
        e->ranks > 1 && e->parts == NULL ? owner : (uint32_t)e->stretch[owner] + (record->point >> e->shift);
    return record;
}

/* ---- to other ranks ---- */

/* Not collective. Groups the records by the rank they go to, and counts them. */
static int sort_by_rank(struct kiln_land_exchange *e, struct kiln_error *error)
{
    int status = kiln_bins_sort(&e->sorted, e->bin_of, e->count, (size_t)e->ranks, e->threads, error);
    if (status == KILN_OK)
        status = kiln_grow(&e->sent, &e->sent_room, e->count, sizeof *e->sent, "the landings of light paths", error);
    if (status != KILN_OK)
        return status;
    for (int r = 0; r < e->ranks; r++) {
        e->exchange.sent_at[r] = e->sorted.begin[r];
        e->exchange.sent[r] = e->sorted.begin[r + 1] - e->sorted.begin[r];
    }
#pragma omp parallel for num_threads((int)e->threads) schedule(static) if (e->count > FEW)
    for (size_t i = 0; i < e->count; i++)
        e->sent[i] = e->records[e->sorted.order[i]];
    return KILN_OK;
}

/* Collective. Exchanges the records, so that each rank has those on its own points. */
static int exchange(struct kiln_land_exchange *e, struct kiln_error *error)
{
    int status = kiln_exchange_count(&e->exchange, sort_by_rank(e, error), error);
    if (status != KILN_OK)
        return status;
    e->count = 0;
    status = kiln_land_exchange_grow(e, e->exchange.got_all, error);
    status = kiln_exchange_send(&e->exchange, status, sizeof *e->records, e->sent, e->records, error);
    e->count = status == KILN_OK ? e->exchange.got_all : 0;
    return status;
}

/* ---- onto points ---- */

double kiln_land_weight(const struct kiln_land_exchange *e, const struct kiln_landing_record *record)
{
    const struct kiln_landing_weights *w = e->weights;
    if (w == NULL)
        return 1.0;
    return kiln_caustic_weight_landed(w->mis, (double)record->others, w->rays, (double)w->area[record->point]);
}

void kiln_land_add(const struct kiln_landing_record *record, double weight, struct kiln_landing_sum *sum)
{
    double irradiance[3];
    for (int c = 0; c < 3; c++) {
        irradiance[c] = weight * (double)record->flux[c] * (double)record->shading;
        sum->irradiance[c] += irradiance[c];
        sum->incident[c] += weight * (double)record->flux[c] * (double)record->taken_up;
    }
    sum->square += kiln_luminance(irradiance) * kiln_luminance(irradiance);
    sum->count++;
}

/* Not collective. Passes the records on, by stretches of points: each thread has some, in their order. */
static int take_all(struct kiln_land_exchange *e, kiln_take_landings take, void *context, struct kiln_error *error)
{
    const struct kiln_landing_record *records = e->records;
    const uint64_t points = e->first[e->rank + 1] - e->first[e->rank];
    const struct kiln_bins *sorted = &e->sorted;
    if (e->threads <= 1 || e->count <= FEW) {
        take(context, &(struct kiln_landing_list){.records = records, .count = e->count});
        return KILN_OK;
    }
    const size_t stretches = (size_t)(points >> e->shift) + 1;
#pragma omp parallel for num_threads((int)e->threads) schedule(static)
    for (size_t i = 0; i < (e->ranks > 1 ? e->count : 0); i++)
        e->bin_of[i] = records[i].point >> e->shift;
    const int status = kiln_bins_sort(&e->sorted, e->bin_of, e->count, stretches, e->threads, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)e->threads) schedule(dynamic, 1)
    for (size_t b = 0; b < stretches; b++) {
        const uint32_t begin = sorted->begin[b], end = sorted->begin[b + 1];
        if (end > begin)
            take(context, &(struct kiln_landing_list){records, sorted->order + begin, end - begin});
    }
    return KILN_OK;
}

/* Not collective. Sorts this rank's records by stretches of all points, in memory that all ranks of the node can
 * read. */
static int lay_open(struct kiln_land_exchange *e, struct kiln_error *error)
{
    const struct part own = part_of(e, e->rank);
    const size_t stretches = (size_t)e->stretch[e->ranks];
    const int status = kiln_bins_sort(&e->sorted, e->bin_of, e->count, stretches, e->threads, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)e->threads) schedule(static) if (e->count > FEW)
    for (size_t i = 0; i < e->count; i++)
        own.order[i] = e->sorted.order[i];
    memcpy(own.begin, e->sorted.begin, (stretches + 1) * sizeof *own.begin);
    return KILN_OK;
}

/* Collective. Passes on the records on this rank's points: each thread has some stretches, with the records of rank 0
 * first, then those of the next. */
static int take_shared(struct kiln_land_exchange *e, kiln_take_landings take, void *context, struct kiln_error *error)
{
    const int status = kiln_agree(e->communicator, lay_open(e, error), error);
    if (status != KILN_OK)
        return status;
    kiln_node_wait(e->node);
#pragma omp parallel for num_threads((int)e->threads) schedule(dynamic, 1)
    for (uint64_t s = e->stretch[e->rank]; s < e->stretch[e->rank + 1]; s++)
        for (int r = 0; r < e->ranks; r++) {
            const struct part part = part_of(e, r);
            const uint32_t begin = part.begin[s], end = part.begin[s + 1];
            if (end > begin)
                take(context, &(struct kiln_landing_list){part.records, part.order + begin, end - begin});
        }
    kiln_node_wait(e->node); /* only now may they be written over */
    return KILN_OK;
}

int kiln_land_exchange(struct kiln_land_exchange *e, kiln_take_landings take, void *context, struct kiln_error *error)
{
    int status = KILN_OK;
    if (e->parts != NULL) {
        status = take_shared(e, take, context, error);
        e->count = 0;
        return status;
    }
    if (e->ranks > 1)
        status = exchange(e, error);
    if (status == KILN_OK)
        status = kiln_agree(e->communicator, take_all(e, take, context, error), error);
    e->count = 0;
    return status;
}
