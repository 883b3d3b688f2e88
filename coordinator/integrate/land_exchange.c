#include "coordinator/integrate/land_exchange.h"

#include <stdlib.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

_Static_assert(sizeof(struct kiln_landing_record) == 40, "a record has no gaps");

int kiln_land_exchange_create(struct kiln_land_exchange *e, MPI_Comm communicator, uint64_t first, uint64_t count,
                              struct kiln_error *error)
{
    *e = (struct kiln_land_exchange){.communicator = communicator};
    (void)MPI_Comm_rank(communicator, &e->rank);
    (void)MPI_Comm_size(communicator, &e->ranks);
    int status = kiln_allocate(&e->first, (size_t)e->ranks + 1, sizeof *e->first, "the ranks' points", error);
    if (status == KILN_OK)
        status = kiln_allocate(&e->counts, 4 * (size_t)e->ranks, sizeof *e->counts, "the ranks' landings", error);
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
    kiln_free(&e->received);
}

/* Points whose sums lie side by side and are one thread's. */
enum { NEIGHBOURS = 64 };

/* By point, then by path. */
static int compare(const void *a, const void *b)
{
    const struct kiln_landing_record *one = a, *other = b;
    if (one->point != other->point)
        return one->point < other->point ? -1 : 1;
    return (one->path > other->path) - (one->path < other->path);
}

/* Fills in how many records go to each rank and come from each, and their places. Returns how many come. */
static size_t count_records(struct kiln_land_exchange *e, const struct kiln_landing_record *records, size_t count)
{
    int *sent = e->counts, *sent_from = sent + e->ranks, *got = sent_from + e->ranks, *got_at = got + e->ranks;
    size_t next = 0, all = 0;
    for (int r = 0; r < e->ranks; r++) {
        const size_t begin = next;
        while (next < count && records[next].point < e->first[r + 1])
            next++;
        sent_from[r] = (int)begin;
        sent[r] = (int)(next - begin);
    }
    (void)MPI_Alltoall(sent, 1, MPI_INT, got, 1, MPI_INT, e->communicator);
    for (int r = 0; r < e->ranks; r++) {
        got_at[r] = (int)all;
        all += (size_t)got[r];
    }
    return all;
}

/* The weight of a landing on an own point. */
static double weigh(const struct kiln_land_exchange *e, const struct kiln_landing_record *record)
{
    const struct kiln_landing_weights *w = e->weights;
    if (w == NULL)
        return 1.0;
    const uint64_t own = record->point - e->first[e->rank];
    const struct kiln_caustic_factors *factors = w->factors != NULL ? &w->factors[w->region_of[own]] : NULL;
    double others = (double)record->others;
    if (factors != NULL && kiln_mis_has_factors(w->mis))
        others = kiln_caustic_others_by(factors, others, (double)record->sampled);
    const double weight = kiln_caustic_weight_landed(w->mis, others, w->rays, (double)w->area[own]);
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

/* Each thread takes the records of some points, in their order. */
static void take_all(const struct kiln_land_exchange *e, const struct kiln_landing_record *records, size_t count,
                     kiln_take_landing take, void *context)
{
    const uint64_t threads = e->threads > 0 ? e->threads : 1;
#pragma omp parallel for num_threads((int)threads) schedule(static, 1) if (count > 1 << 12)
    for (uint64_t thread = 0; thread < threads; thread++)
        for (size_t i = 0; i < count; i++)
            if (records[i].point / NEIGHBOURS % threads == thread)
                take(context, &records[i], weigh(e, &records[i]));
}

int kiln_land_exchange(struct kiln_land_exchange *e, struct kiln_landing_record *records, size_t count,
                       kiln_take_landing take, void *context, struct kiln_error *error)
{
    const struct kiln_landing_record *mine = records;
    MPI_Datatype type;
    if (e->ranks > 1) {
        qsort(records, count, sizeof *records, compare);
        const size_t all = count_records(e, records, count);
        const int *counts = e->counts;
        const int status = kiln_agree(
            e->communicator,
            kiln_grow(&e->received, &e->room, all, sizeof *e->received, "the landings of light paths", error), error);
        if (status != KILN_OK)
            return status;
        (void)MPI_Type_contiguous((int)sizeof *records, MPI_BYTE, &type);
        (void)MPI_Type_commit(&type);
        (void)MPI_Alltoallv(records, counts, counts + e->ranks, type, e->received, counts + 2 * e->ranks,
                            counts + 3 * e->ranks, type, e->communicator);
        (void)MPI_Type_free(&type);
        mine = e->received;
        count = all;
    }
    take_all(e, mine, count, take, context);
    return KILN_OK;
}
