#include "coordinator/mpi/redistribute.h"

#include <limits.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum { TAG_MOVE = 13 };

struct move {
    MPI_Comm communicator;
    MPI_Datatype type;
    size_t size;
    uint64_t limit;
    MPI_Request *requests;
    size_t count, room;
};

/* What two ranges have in common; empty where begin >= end. */
struct common {
    uint64_t begin, end;
};

static struct common common_of(const uint64_t *a, const uint64_t *b)
{
    return (struct common){a[0] > b[0] ? a[0] : b[0], a[1] < b[1] ? a[1] : b[1]};
}

static MPI_Request *new_request(struct move *m)
{
    struct kiln_error error;
    if (kiln_grow(&m->requests, &m->room, m->count + 1, sizeof *m->requests, "messages that move points", &error) !=
        KILN_OK)
        kiln_end_all_ranks(KILN_SYSTEM, &error); /* others wait for it already */
    return &m->requests[m->count++];
}

/* `there`: of the common range's first element. */
static void receive(struct move *m, struct common c, int rank, char *there)
{
    for (uint64_t at = c.begin; at < c.end; at += m->limit) {
        const uint64_t count = c.end - at < m->limit ? c.end - at : m->limit;
        (void)MPI_Irecv(there + (at - c.begin) * m->size, (int)count, m->type, rank, TAG_MOVE, m->communicator,
                        new_request(m));
    }
}

static void send(struct move *m, struct common c, int rank, const char *there)
{
    for (uint64_t at = c.begin; at < c.end; at += m->limit) {
        const uint64_t count = c.end - at < m->limit ? c.end - at : m->limit;
        (void)MPI_Isend(there + (at - c.begin) * m->size, (int)count, m->type, rank, TAG_MOVE, m->communicator,
                        new_request(m));
    }
}

void kiln_redistribute(MPI_Comm communicator, const uint64_t *before, const uint64_t *after, size_t size,
                       uint64_t limit, const void *from, void *to)
{
    int rank, ranks;
    struct move m = {
        .communicator = communicator, .size = size, .limit = limit > 0 && limit < INT_MAX ? limit : INT_MAX};
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    (void)MPI_Type_contiguous((int)size, MPI_BYTE, &m.type);
    (void)MPI_Type_commit(&m.type);
    for (int r = 0; r < ranks; r++) {
        const struct common c = common_of(&before[r], &after[rank]);
        if (r != rank)
            receive(&m, c, r, (char *)to + (c.begin - after[rank]) * size);
        else if (c.begin < c.end)
            memcpy((char *)to + (c.begin - after[rank]) * size, (const char *)from + (c.begin - before[rank]) * size,
                   (c.end - c.begin) * size);
    }
    for (int r = 0; r < ranks; r++) {
        const struct common c = common_of(&before[rank], &after[r]);
        if (r != rank)
            send(&m, c, r, (const char *)from + (c.begin - before[rank]) * size);
    }
    while (m.count > 0) { /* as many at a time as can be counted */
        const size_t some = m.count < INT_MAX ? m.count : INT_MAX;
        (void)MPI_Waitall((int)some, m.requests + (m.count - some), MPI_STATUSES_IGNORE);
        m.count -= some;
    }
    kiln_free(&m.requests);
    (void)MPI_Type_free(&m.type);
}
