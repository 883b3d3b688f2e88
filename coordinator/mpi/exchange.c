#include "coordinator/mpi/exchange.h"

#include <limits.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"
#include "worker/base/memory.h"

enum { TAG_EXCHANGE = 70, COPIED_AT_ONCE = 1 << 18 };

int kiln_exchange_create(struct kiln_exchange *e, MPI_Comm communicator, uint64_t limit, const char *what,
                         struct kiln_error *error)
{
    *e = (struct kiln_exchange){.communicator = communicator,
                                .limit = limit > 0 && limit < INT_MAX ? limit : INT_MAX,
                                .what = what,
                                .type = MPI_DATATYPE_NULL};
    uint64_t **arrays[] = {&e->sent, &e->sent_at, &e->got, &e->got_at};
    int status = KILN_OK;
    kiln_assert_same(communicator, limit, "the limit of a message");
    (void)MPI_Comm_rank(communicator, &e->rank);
    (void)MPI_Comm_size(communicator, &e->ranks);
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays && status == KILN_OK; i++)
        status = kiln_allocate(arrays[i], (size_t)e->ranks, sizeof **arrays, what, error);
    return kiln_agree(communicator, status, error);
}

void kiln_exchange_release(struct kiln_exchange *e)
{
    kiln_free(&e->sent);
    kiln_free(&e->sent_at);
    kiln_free(&e->got);
    kiln_free(&e->got_at);
    kiln_free(&e->requests);
}

/* Where elements begin that follow one another. Returns how many there are. */
static uint64_t follow(const uint64_t *counts, uint64_t *places, int ranks)
{
    uint64_t total = 0;
    for (int r = 0; r < ranks; r++) {
        places[r] = total;
        total += counts[r];
    }
    return total;
}

void kiln_exchange_lay_out(struct kiln_exchange *e) { e->sent_all = follow(e->sent, e->sent_at, e->ranks); }

void kiln_exchange_turn(struct kiln_exchange *e)
{
    uint64_t *const sent = e->sent, *const sent_at = e->sent_at, sent_all = e->sent_all;
    e->sent = e->got;
    e->sent_at = e->got_at;
    e->sent_all = e->got_all;
    e->got = sent;
    e->got_at = sent_at;
    e->got_all = sent_all;
}

static int lost(const struct kiln_exchange *e, struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "MPI failed while ranks exchanged %s; run the same command again", e->what);
}

int kiln_exchange_count(struct kiln_exchange *e, int status, struct kiln_error *error)
{
    status = kiln_agree(e->communicator, status, error);
    if (status != KILN_OK)
        return status;
    if (MPI_Alltoall(e->sent, 1, MPI_UINT64_T, e->got, 1, MPI_UINT64_T, e->communicator) != MPI_SUCCESS)
        return lost(e, error);
    e->got_all = follow(e->got, e->got_at, e->ranks);
    return KILN_OK;
}

/* ---- messages ---- */

static uint64_t messages(const struct kiln_exchange *e, const uint64_t *counts)
{
    uint64_t all = 0;
    for (int r = 0; r < e->ranks; r++)
        all += r == e->rank ? 0 : counts[r] / e->limit + (counts[r] % e->limit > 0);
    return all;
}

/* Makes room for requests, and a type of an element. */
static int prepare(struct kiln_exchange *e, size_t size, struct kiln_error *error)
{
    const uint64_t needed = messages(e, e->sent) + messages(e, e->got);
    const int status = kiln_grow(&e->requests, &e->request_room, needed, sizeof(MPI_Request), e->what, error);
    if (status != KILN_OK)
        return status;
    if (size > INT_MAX || MPI_Type_contiguous((int)size, MPI_BYTE, &e->type) != MPI_SUCCESS ||
        MPI_Type_commit(&e->type) != MPI_SUCCESS)
        return kiln_fail(error, KILN_SITE, "MPI refused a datatype of %zu bytes", size);
    return KILN_OK;
}

static void forget_type(struct kiln_exchange *e)
{
    if (e->type != MPI_DATATYPE_NULL)
        (void)MPI_Type_free(&e->type);
}

static MPI_Request *new_request(struct kiln_exchange *e)
{
    e->requests[e->request_count] = MPI_REQUEST_NULL;
    return &e->requests[e->request_count++];
}

static void note(struct kiln_exchange *e, int result) { e->result = result == MPI_SUCCESS ? e->result : result; }

static int piece(const struct kiln_exchange *e, uint64_t left) { return (int)(left < e->limit ? left : e->limit); }

static void receive(struct kiln_exchange *e, int rank, size_t size, char *in)
{
    for (uint64_t at = 0; at < e->got[rank]; at += e->limit)
        note(e, MPI_Irecv(in + (e->got_at[rank] + at) * size, piece(e, e->got[rank] - at), e->type, rank, TAG_EXCHANGE,
                          e->communicator, new_request(e)));
}

static void send(struct kiln_exchange *e, int rank, size_t size, const char *out)
{
    for (uint64_t at = 0; at < e->sent[rank]; at += e->limit)
        note(e, MPI_Isend(out + (e->sent_at[rank] + at) * size, piece(e, e->sent[rank] - at), e->type, rank,
                          TAG_EXCHANGE, e->communicator, new_request(e)));
}

static void copy_own(const struct kiln_exchange *e, size_t size, const char *out, char *in)
{
    const size_t bytes = e->sent[e->rank] * size;
    const char *from = bytes > 0 ? out + e->sent_at[e->rank] * size : NULL;
    char *to = bytes > 0 ? in + e->got_at[e->rank] * size : NULL;
#pragma omp parallel for schedule(static) if (bytes > COPIED_AT_ONCE)
    for (size_t at = 0; at < bytes; at += COPIED_AT_ONCE)
        memcpy(to + at, from + at, bytes - at < COPIED_AT_ONCE ? bytes - at : COPIED_AT_ONCE);
}

int kiln_exchange_begin(struct kiln_exchange *e, int status, size_t size, const void *out, void *in,
                        struct kiln_error *error)
{
    kiln_assert_same(e->communicator, size, "the size of elements that ranks exchange");
    if (status == KILN_OK)
        status = prepare(e, size, error);
    status = kiln_agree(e->communicator, status, error);
    if (status != KILN_OK) {
        forget_type(e);
        return status;
    }
    e->result = MPI_SUCCESS;
    for (int i = 1; i < e->ranks; i++) /* each rank begins with another one */
        receive(e, (e->rank + e->ranks - i) % e->ranks, size, in);
    for (int i = 1; i < e->ranks; i++)
        send(e, (e->rank + i) % e->ranks, size, out);
    copy_own(e, size, out, in);
    return KILN_OK;
}

int kiln_exchange_end(struct kiln_exchange *e, int status, struct kiln_error *error)
{
    while (e->request_count > 0) { /* MPI counts requests in an int */
        const size_t some = e->request_count < INT_MAX ? e->request_count : INT_MAX;
        e->request_count -= some;
        note(e, MPI_Waitall((int)some, e->requests + e->request_count, MPI_STATUSES_IGNORE));
    }
    forget_type(e);
    if (status == KILN_OK && e->result != MPI_SUCCESS)
        status = lost(e, error);
    return kiln_agree(e->communicator, status, error);
}

int kiln_exchange_send(struct kiln_exchange *e, int status, size_t size, const void *out, void *in,
                       struct kiln_error *error)
{
    status = kiln_exchange_begin(e, status, size, out, in, error);
    return status == KILN_OK ? kiln_exchange_end(e, KILN_OK, error) : status;
}

int kiln_exchange_all(struct kiln_exchange *e, int status, size_t size, const void *out, void *in,
                      struct kiln_error *error)
{
    void *received = NULL;
    status = kiln_exchange_count(e, status, error);
    if (status == KILN_OK) {
        status = kiln_allocate_bare(&received, e->got_all, size, e->what, error);
        status = kiln_exchange_send(e, status, size, out, received, error);
    }
    if (status != KILN_OK)
        kiln_free(&received);
    memcpy(in, &received, sizeof received);
    return status;
}
