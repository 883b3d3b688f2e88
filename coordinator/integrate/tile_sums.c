#include "coordinator/integrate/tile_sums.h"

void kiln_tiles_reduce(MPI_Comm communicator, const struct kiln_integrate_settings *settings, uint64_t *values,
                       uint64_t count)
{
    const uint64_t limit = settings->exchange_limit, most = limit > 0 && limit < 1u << 30 ? limit : 1u << 30;
    for (uint64_t at = 0; at < count; at += most)
        (void)MPI_Allreduce(MPI_IN_PLACE, values + at, (int)(count - at < most ? count - at : most), MPI_UINT64_T,
                            MPI_SUM, communicator);
}
