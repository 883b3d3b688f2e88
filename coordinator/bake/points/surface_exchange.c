#include "coordinator/bake/points/surface_exchange.h"

#include <limits.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/exchange.h"
#include "worker/base/memory.h"

enum { ROUND_BYTES = 32 << 20 };

static int agree(void *context, int status, struct kiln_error *error)
{
    const struct kiln_surface_meeting *m = context;
    return kiln_agree(m->communicator, status, error);
}

static int sum(void *context, int status, uint64_t *values, uint64_t *before, size_t count, struct kiln_error *error)
{
    const struct kiln_surface_meeting *m = context;
    int rank;
    status = kiln_agree(m->communicator, status, error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Comm_rank(m->communicator, &rank);
    for (size_t at = 0; at < count;) {
        const int piece = count - at < INT_MAX ? (int)(count - at) : INT_MAX;
        if (before != NULL)
            (void)MPI_Exscan(values + at, before + at, piece, MPI_UINT64_T, MPI_SUM, m->communicator);
        (void)MPI_Allreduce(MPI_IN_PLACE, values + at, piece, MPI_UINT64_T, MPI_SUM, m->communicator);
        at += (size_t)piece;
    }
    if (before != NULL && rank == 0) /* MPI_Exscan leaves the result of rank 0 undefined */
        memset(before, 0, count * sizeof *before);
    return KILN_OK;
}

static size_t records_at_once(const struct kiln_surface_meeting *m, size_t size)
{
    const size_t limit = m->limit > 0 ? m->limit : ROUND_BYTES;
    return limit > size ? limit / size : 1;
}

/* ---- allgather in rounds ---- */

struct rounds {
    uint64_t *records;    /* number of records of each rank */
    int *counts, *places; /* of each rank in a round, bytes */
    int ranks;
    uint64_t number;
    char *arrived; /* the records of a round */
};

/* Number of a rank's records that come before round `round`, of `number` rounds; the same on all ranks. */
static uint64_t round_begin(uint64_t records, uint64_t round, uint64_t number)
{
    return records / number * round + records % number * round / number;
}

/* Computes where the records of each rank are placed in a round; returns their total size in bytes. */
static uint64_t lay_out(struct rounds *r, uint64_t round, size_t size)
{
    uint64_t bytes = 0;
    for (int i = 0; i < r->ranks; i++) {
        const uint64_t count =
            round_begin(r->records[i], round + 1, r->number) - round_begin(r->records[i], round, r->number);
        r->places[i] = (int)bytes;
        r->counts[i] = (int)(count * size);
        bytes += count * size;
    }
    return bytes;
}

static int plan_rounds(struct rounds *r, const struct kiln_surface_meeting *m, size_t count, size_t size,
                       struct kiln_error *error)
{
    const char *what = "the records of all ranks about the surface";
    const uint64_t own = count;
    uint64_t total = 0, most = 0;
    (void)MPI_Comm_size(m->communicator, &r->ranks);
    const size_t ranks = (size_t)r->ranks;
    int status;
    KILN_TRY(kiln_allocate(&r->records, ranks, sizeof *r->records, what, error));
    KILN_TRY(kiln_allocate(&r->counts, ranks, sizeof *r->counts, what, error));
    KILN_TRY(kiln_allocate(&r->places, ranks, sizeof *r->places, what, error));
end:
    status = kiln_agree(m->communicator, status, error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Allgather(&own, 1, MPI_UINT64_T, r->records, 1, MPI_UINT64_T, m->communicator);
    for (size_t i = 0; i < ranks; i++)
        total += r->records[i];
    r->number = (total + records_at_once(m, size) - 1) / records_at_once(m, size);
    for (uint64_t round = 0; round < r->number; round++) {
        const uint64_t bytes = lay_out(r, round, size);
        most = bytes > most ? bytes : most;
    }
    return kiln_agree(m->communicator, kiln_allocate(&r->arrived, most, 1, what, error), error);
}

static int allgather(void *context, int status, const void *own, size_t count, size_t size, kiln_surface_taker take,
                     void *taker, struct kiln_error *error)
{
    const struct kiln_surface_meeting *m = context;
    struct rounds rounds = {0};
    int rank;
    status = kiln_agree(m->communicator, status, error);
    if (status == KILN_OK)
        status = plan_rounds(&rounds, m, count, size, error);
    (void)MPI_Comm_rank(m->communicator, &rank);
    for (uint64_t round = 0; round < rounds.number && status == KILN_OK; round++) {
        const uint64_t bytes = lay_out(&rounds, round, size);
        const char *begin = count > 0 ? (const char *)own + round_begin(count, round, rounds.number) * size : NULL;
        (void)MPI_Allgatherv(begin, rounds.counts[rank], MPI_BYTE, rounds.arrived, rounds.counts, rounds.places,
                             MPI_BYTE, m->communicator);
        take(taker, rounds.arrived, bytes / size);
    }
    kiln_free(&rounds.records);
    kiln_free(&rounds.counts);
    kiln_free(&rounds.places);
    kiln_free(&rounds.arrived);
    return status;
}

/* ---- exchange between pairs of ranks ---- */

static int alltoall(void *context, int status, const void *own, const size_t *counts, size_t size,
                    kiln_surface_taker take, void *taker, struct kiln_error *error)
{
    const struct kiln_surface_meeting *m = context;
    struct kiln_exchange e = {0};
    char *arrived = NULL;
    KILN_TRY(kiln_agree(m->communicator, status, error));
    KILN_TRY(kiln_exchange_create(&e, m->communicator, records_at_once(m, size),
                                  "the records that ranks exchange about the surface", error));
    for (int r = 0; r < e.ranks; r++)
        e.sent[r] = counts[r];
    kiln_exchange_lay_out(&e);
    KILN_TRY(kiln_exchange_all(&e, KILN_OK, size, own, &arrived, error));
    take(taker, arrived, e.got_all);
end:
    kiln_exchange_release(&e);
    kiln_free(&arrived);
    return status;
}

struct kiln_surface_exchange kiln_surface_exchange_over(struct kiln_surface_meeting *meeting)
{
    return (struct kiln_surface_exchange){
        .context = meeting, .agree = agree, .sum = sum, .allgather = allgather, .alltoall = alltoall};
}
