#include "coordinator/integrate/patches/emission.h"

#include "coordinator/integrate/energy.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/emission.h"

int kiln_trace_emission(MPI_Comm communicator, struct kiln_backend *backend, struct kiln_emission_result *result,
                        struct kiln_error *error)
{
    struct kiln_emission_result groups[KILN_EMISSION_GROUPS];
    enum { NUMBERS = sizeof groups / (sizeof(double)) }; /* it has nothing else */
    int rank, ranks;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    int status = kiln_emission_groups(backend, KILN_EMISSION_SAMPLES, (uint32_t)rank, (uint32_t)ranks, groups, error);
    status = kiln_agree(communicator, status, error);
    if (status == KILN_OK) { /* each number is nonzero on one rank only, so the sum rounds nothing */
        (void)MPI_Allreduce(MPI_IN_PLACE, groups, NUMBERS, MPI_DOUBLE, MPI_SUM, communicator);
        kiln_emission_combine(groups, result);
    }
    return status;
}
