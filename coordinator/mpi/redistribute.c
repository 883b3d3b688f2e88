#include "coordinator/mpi/redistribute.h"

#include <limits.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"
#include "worker/base/memory.h"

enum { TAG_REDISTRIBUTE = 13 };

struct transfer {
    MPI_Comm communicator;
    MPI_Datatype type;
    size_t size;    /* bytes of an element */
    uint64_t limit; /* elements in a message */
    MPI_Request *requests;
    size_t count, room;
};

/* The intersection of two ranges; empty where begin >= end. */
struct overlap {
    uint64_t begin, end;
};

static struct overlap overlap_of(const uint64_t *a, const uint64_t *b)
{
    return (struct overlap){a[0] > b[0] ? a[0] : b[0], a[1] < b[1] ? a[1] : b[1]};
}

static MPI_Request *new_request(struct transfer *m)
{
    struct kiln_error error;
    if (kiln_grow(&m->requests, &m->room, m->count + 1, sizeof *m->requests, "messages that redistribute points",
                  &error) != KILN_OK)
        kiln_end_all_ranks(KILN_SYSTEM, &error); /* other ranks already wait for this message */
    return &m->requests[m->count++];
}

/* `there` is the address of the first element of the overlap. */
static void receive(struct transfer *m, struct overlap c, int rank, char *there)
{
    for (uint64_t at = c.begin; at < c.end; at += m->limit) {
        const uint64_t count = c.end - at < m->limit ? c.end - at : m->limit;
        (void)MPI_Irecv(there + (at - c.begin) * m->size, (int)count, m->type, rank, TAG_REDISTRIBUTE, m->communicator,
                        new_request(m));
    }
}

static void send(struct transfer *m, struct overlap c, int rank, const char *there)
{
    for (uint64_t at = c.begin; at < c.end; at += m->limit) {
        const uint64_t count = c.end - at < m->limit ? c.end - at : m->limit;
        (void)MPI_Isend(there + (at - c.begin) * m->size, (int)count, m->type, rank, TAG_REDISTRIBUTE, m->communicator,
                        new_request(m));
    }
}

void kiln_redistribute(MPI_Comm communicator, const uint64_t *before, const uint64_t *after, size_t size,
                       uint64_t limit, const void *from, void *to)
{
    int rank, ranks;
    struct transfer m = {
        .communicator = communicator, .size = size, .limit = limit > 0 && limit < INT_MAX ? limit : INT_MAX};
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    kiln_assert_same_bytes(communicator, before, ((size_t)ranks + 1) * sizeof *before, "the ranges before a move");
    kiln_assert_same_bytes(communicator, after, ((size_t)ranks + 1) * sizeof *after, "the ranges after a move");
    kiln_assert_same(communicator, size, "the size of the elements that move");
    kiln_assert_same(communicator, limit, "the limit of a message");
    (void)MPI_Type_contiguous((int)size, MPI_BYTE, &m.type);
    (void)MPI_Type_commit(&m.type);
    for (int r = 0; r < ranks; r++) {
        const struct overlap c = overlap_of(&before[r], &after[rank]);
        if (r != rank)
            receive(&m, c, r, (char *)to + (c.begin - after[rank]) * size);
        else if (c.begin < c.end)
            memcpy((char *)to + (c.begin - after[rank]) * size, (const char *)from + (c.begin - before[rank]) * size,
                   (c.end - c.begin) * size);
    }
    for (int r = 0; r < ranks; r++) {
        const struct overlap c = overlap_of(&before[rank], &after[r]);
        if (r != rank)
            send(&m, c, r, (const char *)from + (c.begin - before[rank]) * size);
    }
    while (m.count > 0) { /* MPI counts requests in an int */
        const size_t some = m.count < INT_MAX ? m.count : INT_MAX;
        (void)MPI_Waitall((int)some, m.requests + (m.count - some), MPI_STATUSES_IGNORE);
        m.count -= some;
    }
    kiln_free(&m.requests);
    (void)MPI_Type_free(&m.type);
}
