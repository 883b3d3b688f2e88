#include "coordinator/cli/agree.h"

static int lost(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "a rank was lost while the ranks compared their results; run the same command again");
}

int kiln_agree(MPI_Comm communicator, int status, struct kiln_error *error)
{
    struct {
        int status, rank;
    } own = {status, 0}, worst = {status, 0};
    if (MPI_Comm_rank(communicator, &own.rank) != MPI_SUCCESS)
        return lost(error);
    /* On equal values MAXLOC keeps the lowest rank. */
    if (MPI_Allreduce(&own, &worst, 1, MPI_2INT, MPI_MAXLOC, communicator) != MPI_SUCCESS)
        return lost(error);
    if (worst.status == KILN_OK)
        return KILN_OK;
    struct kiln_error sentence = {{0}};
    if (worst.rank == own.rank && error != NULL)
        sentence = *error;
    if (MPI_Bcast(&sentence, (int)sizeof sentence, MPI_BYTE, worst.rank, communicator) != MPI_SUCCESS)
        return lost(error);
    if (error != NULL)
        *error = sentence;
    return worst.status;
}
