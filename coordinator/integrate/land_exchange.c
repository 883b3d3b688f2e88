#include "coordinator/integrate/land_exchange.h"

#include <string.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

_Static_assert(sizeof(struct kiln_landing_record) == 32, "a record has no gaps");

/* Points whose sums lie side by side, and are one thread's: a power of two; more where there would be too many
 * stretches of them. */
enum { STRETCH = 256, STRETCHES_MOST = 1 << 13 };
enum { FEW = 1 << 12 }; /* records that are not worth several threads */

int kiln_land_exchange_create(struct kiln_land_exchange *e, MPI_Comm communicator, uint64_t first, uint64_t count,
                              struct kiln_error *error)
{
    *e = (struct kiln_land_exchange){.communicator = communicator};
    (void)MPI_Comm_rank(communicator, &e->rank);
    (void)MPI_Comm_size(communicator, &e->ranks);
    int status = kiln_allocate(&e->first, (size_t)e->ranks + 1, sizeof *e->first, "the ranks' points", error);
    if (status == KILN_OK)
        status = kiln_allocate(&e->counts, 4 * (size_t)e->ranks, sizeof *e->counts, "the ranks' landings", error);
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
    return KILN_OK;
}

void kiln_land_exchange_release(struct kiln_land_exchange *e)
{
    kiln_free(&e->first);
    kiln_free(&e->counts);
    kiln_free(&e->records);
    kiln_free(&e->owners);
    kiln_free(&e->sent);
    kiln_free(&e->order);
    kiln_free(&e->starts);
}

/* ---- records of paths ---- */

int kiln_land_exchange_grow(struct kiln_land_exchange *e, size_t more, struct kiln_error *error)
{
    const size_t needed = e->count + more;
    int status = kiln_grow(&e->records, &e->room, needed, sizeof *e->records, "the landings of light paths", error);
    if (status == KILN_OK && e->ranks > 1)
        status = kiln_grow(&e->owners, &e->owner_room, needed, sizeof *e->owners, "the landings of light paths", error);
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

void kiln_land_exchange_put(struct kiln_land_exchange *e, size_t at, uint64_t point,
                            const struct kiln_landing_record *record)
{
    const uint32_t owner = owner_of(e, point);
    e->records[at] = *record;
    e->records[at].point = (uint32_t)(point - e->first[owner]);
    if (e->ranks > 1)
        e->owners[at] = owner;
}

/* ---- parts ---- */

/* Records are sorted in parts of consecutive ones, each of which one thread counts by bin, and then moves: those of a
 * bin stay in their order. */
static size_t parts_of(const struct kiln_land_exchange *e, size_t count)
{
    return e->threads > 1 && count > FEW ? e->threads : 1;
}

static size_t part_begin(size_t count, size_t part, size_t parts)
{
    return count / parts * part + (part < count % parts ? part : count % parts);
}

static int make_starts(struct kiln_land_exchange *e, size_t parts, size_t bins, struct kiln_error *error)
{
    const size_t needed = parts * bins;
    const int status = kiln_grow(&e->starts, &e->start_room, needed, sizeof *e->starts, "the order of landings", error);
    if (status == KILN_OK)
        memset(e->starts, 0, needed * sizeof *e->starts);
    return status;
}

/* From how many records of each bin a part has to where they go. */
static void add_up_starts(uint32_t *starts, size_t parts, size_t bins)
{
    uint32_t next = 0;
    for (size_t bin = 0; bin < bins; bin++)
        for (size_t part = 0; part < parts; part++) {
            const uint32_t count = starts[part * bins + bin];
            starts[part * bins + bin] = next;
            next += count;
        }
}

/* ---- to other ranks ---- */

/* Not collective. Puts the records side by side that go to a rank, and fills in how many they are. */
static int sort_by_rank(struct kiln_land_exchange *e, struct kiln_error *error)
{
    const size_t ranks = (size_t)e->ranks, count = e->count, parts = parts_of(e, count);
    int *sent = e->counts, *sent_from = sent + ranks;
    int status = make_starts(e, parts, ranks, error);
    if (status == KILN_OK)
        status = kiln_grow(&e->sent, &e->sent_room, count, sizeof *e->sent, "the landings of light paths", error);
    if (status != KILN_OK)
        return status;
    uint32_t *starts = e->starts;
#pragma omp parallel for num_threads((int)parts) schedule(static, 1)
    for (size_t part = 0; part < parts; part++)
        for (size_t i = part_begin(count, part, parts); i < part_begin(count, part + 1, parts); i++)
            starts[part * ranks + e->owners[i]]++;
    add_up_starts(starts, parts, ranks);
    for (size_t r = 0; r < ranks; r++) {
        sent_from[r] = (int)starts[r];
        sent[r] = (int)(r + 1 < ranks ? starts[r + 1] : (uint32_t)count) - sent_from[r];
    }
#pragma omp parallel for num_threads((int)parts) schedule(static, 1)
    for (size_t part = 0; part < parts; part++)
        for (size_t i = part_begin(count, part, parts); i < part_begin(count, part + 1, parts); i++)
            e->sent[starts[part * ranks + e->owners[i]]++] = e->records[i];
    return KILN_OK;
}

/* Collective. The records become those on own points. */
static int exchange(struct kiln_land_exchange *e, struct kiln_error *error)
{
    int *sent = e->counts, *sent_from = sent + e->ranks, *got = sent_from + e->ranks, *got_at = got + e->ranks;
    MPI_Datatype type;
    size_t all = 0;
    int status = kiln_agree(e->communicator, sort_by_rank(e, error), error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Alltoall(sent, 1, MPI_INT, got, 1, MPI_INT, e->communicator);
    for (int r = 0; r < e->ranks; r++) {
        got_at[r] = (int)all;
        all += (size_t)got[r];
    }
    e->count = 0;
    status = kiln_agree(e->communicator, kiln_land_exchange_grow(e, all, error), error);
    if (status != KILN_OK)
        return status;
    e->count = all;
    (void)MPI_Type_contiguous((int)sizeof *e->records, MPI_BYTE, &type);
    (void)MPI_Type_commit(&type);
    (void)MPI_Alltoallv(e->sent, sent, sent_from, type, e->records, got, got_at, type, e->communicator);
    (void)MPI_Type_free(&type);
    return KILN_OK;
}

/* ---- onto points ---- */

double kiln_land_weight(const struct kiln_land_exchange *e, const struct kiln_landing_record *record)
{
    const struct kiln_landing_weights *w = e->weights;
    if (w == NULL)
        return 1.0;
    const struct kiln_caustic_factors *factors = w->factors != NULL ? &w->factors[w->region_of[record->point]] : NULL;
    double others = (double)record->others;
    if (factors != NULL && kiln_mis_has_factors(w->mis))
        others = kiln_caustic_others_by(factors, others, (double)record->sampled);
    const double weight = kiln_caustic_weight_landed(w->mis, others, w->rays, (double)w->area[record->point]);
    return factors != NULL && w->mis == KILN_MIS_OPTIMAL ? kiln_caustic_exchanged_landed(factors, weight) : weight;
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

/* Each thread takes the records of stretches of points, in their order. Not collective. */
static int take_all(struct kiln_land_exchange *e, kiln_take_landings take, void *context, struct kiln_error *error)
{
    const size_t count = e->count, parts = parts_of(e, count);
    if (parts == 1) {
        take(context, &(struct kiln_landing_list){.records = e->records, .count = count});
        return KILN_OK;
    }
    const uint64_t points = e->first[e->rank + 1] - e->first[e->rank];
    uint64_t stretch = STRETCH;
    while (points / stretch >= STRETCHES_MOST)
        stretch *= 2;
    const size_t bins = (size_t)(points / stretch) + 1;
    const int shift = __builtin_ctzll(stretch);
    int status = make_starts(e, parts, bins, error);
    if (status == KILN_OK)
        status = kiln_grow(&e->order, &e->order_room, count, sizeof *e->order, "the order of landings", error);
    if (status != KILN_OK)
        return status;
    const struct kiln_landing_record *records = e->records;
    uint32_t *starts = e->starts, *order = e->order;
#pragma omp parallel num_threads((int)parts)
    {
#pragma omp for schedule(static, 1)
        for (size_t part = 0; part < parts; part++)
            for (size_t i = part_begin(count, part, parts); i < part_begin(count, part + 1, parts); i++)
                starts[part * bins + (records[i].point >> shift)]++;
#pragma omp single
        add_up_starts(starts, parts, bins);
#pragma omp for schedule(static, 1)
        for (size_t part = 0; part < parts; part++)
            for (size_t i = part_begin(count, part, parts); i < part_begin(count, part + 1, parts); i++)
                order[starts[part * bins + (records[i].point >> shift)]++] = (uint32_t)i;
                /* by now a bin ends where its last part does */
#pragma omp for schedule(dynamic, 1)
        for (size_t bin = 0; bin < bins; bin++) {
            const uint32_t *ends = starts + (parts - 1) * bins, begin = bin > 0 ? ends[bin - 1] : 0;
            if (ends[bin] > begin)
                take(context, &(struct kiln_landing_list){records, order + begin, ends[bin] - begin});
        }
    }
    return KILN_OK;
}

int kiln_land_exchange(struct kiln_land_exchange *e, kiln_take_landings take, void *context, struct kiln_error *error)
{
    int status = e->ranks > 1 ? exchange(e, error) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_agree(e->communicator, take_all(e, take, context, error), error);
    e->count = 0;
    return status;
}
