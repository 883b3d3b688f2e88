#include "coordinator/mpi/redistribute.h"

#include "coordinator/mpi/assert_same.h"
#include "coordinator/mpi/exchange.h"

/* Elements in two ranges. *at: where the first of them lies in the range that begins at `origin`. */
static uint64_t overlap(const uint64_t *a, const uint64_t *b, uint64_t origin, uint64_t *at)
{
    const uint64_t begin = a[0] > b[0] ? a[0] : b[0], end = a[1] < b[1] ? a[1] : b[1];
    *at = begin - origin;
    return begin < end ? end - begin : 0;
}

int kiln_redistribute(MPI_Comm communicator, const uint64_t *before, const uint64_t *after, size_t size, uint64_t limit,
                      const void *from, void *to, struct kiln_error *error)
{
    struct kiln_exchange e;
    int status;
    KILN_TRY(kiln_exchange_create(&e, communicator, limit, "points that get other ranks", error));
    kiln_assert_same_bytes(communicator, before, ((size_t)e.ranks + 1) * sizeof *before, "the ranges before a move");
    kiln_assert_same_bytes(communicator, after, ((size_t)e.ranks + 1) * sizeof *after, "the ranges after a move");
    kiln_assert_same(communicator, size, "the size of the elements that move");
    kiln_assert_same(communicator, limit, "the limit of a message");
    for (int r = 0; r < e.ranks; r++) {
        e.sent[r] = overlap(&before[e.rank], &after[r], before[e.rank], &e.sent_at[r]);
        e.got[r] = overlap(&before[r], &after[e.rank], after[e.rank], &e.got_at[r]);
    }
    KILN_TRY(kiln_exchange_send(&e, KILN_OK, size, from, to, error));
end:
    kiln_exchange_release(&e);
    return status;
}
