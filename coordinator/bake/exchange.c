#include "coordinator/bake/exchange.h"

#include <limits.h>

#include "worker/base/memory.h"

/* Within int: one collective call. */
static void gather_at_once(MPI_Comm communicator, uint64_t *all, const uint64_t *ranges, int ranks, int *counts, int *places)
{
    for (int r = 0; r < ranks; r++) {
        places[r] = (int)ranges[2 * r];
        counts[r] = (int)ranges[2 * r + 1];
    }
    (void)MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, all, counts, places, MPI_UINT64_T, communicator);
}

/* Beyond: each rank's range in parts that an int can count. */
static void send_in_parts(MPI_Comm communicator, uint64_t *all, const uint64_t *ranges, int ranks)
{
    const uint64_t part = 1u << 27;
    for (int r = 0; r < ranks; r++)
        for (uint64_t sent = 0; sent < ranges[2 * r + 1]; sent += part) {
            const uint64_t rest = ranges[2 * r + 1] - sent;
            (void)MPI_Bcast(all + ranges[2 * r] + sent, (int)(rest < part ? rest : part), MPI_UINT64_T, r, communicator);
        }
}

int kiln_exchange(MPI_Comm communicator, uint64_t *all, uint64_t total, uint64_t first, uint64_t count, struct kiln_error *error)
{
    int ranks;
    (void)MPI_Comm_size(communicator, &ranks);
    if (ranks == 1)
        return KILN_OK;
    uint64_t *ranges = NULL;
    int *counts = NULL;
    int status = kiln_allocate(&ranges, 2 * (size_t)ranks, sizeof *ranges, "the ranks' shares", error);
    if (status == KILN_OK)
        status = kiln_allocate(&counts, 2 * (size_t)ranks, sizeof *counts, "the ranks' shares", error);
    if (status == KILN_OK) {
        const uint64_t own[2] = {first, count};
        (void)MPI_Allgather(own, 2, MPI_UINT64_T, ranges, 2, MPI_UINT64_T, communicator);
        if (total <= INT_MAX)
            gather_at_once(communicator, all, ranges, ranks, counts, counts + ranks);
        else
            send_in_parts(communicator, all, ranges, ranks);
    }
    kiln_free(&ranges);
    kiln_free(&counts);
    return status;
}
