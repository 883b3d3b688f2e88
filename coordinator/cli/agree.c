#include "coordinator/cli/agree.h"

#include <stdio.h>
#include <unistd.h>

static int lost(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "a rank was lost while the ranks compared their results; run the same command again");
}

/* Whose memory or threads are at an end only the rank knows: as all print the same sentence, it has to say so. */
static void name_rank(struct kiln_error *sentence)
{
    struct kiln_error told = *sentence;
    char host[64] = "";
    int rank, named;
    if (MPI_Comm_rank(MPI_COMM_WORLD, &rank) != MPI_SUCCESS || sscanf(told.message, "rank %d on ", &named) == 1)
        return;
    (void)gethostname(host, sizeof host - 1);
    (void)kiln_fail(sentence, KILN_SYSTEM, "rank %d on %s: %s", rank, host, told.message);
}

void kiln_end_all_ranks(int status, const struct kiln_error *error)
{
    struct kiln_error sentence = *error;
    name_rank(&sentence);
    (void)fprintf(stderr, "kiln: error: %s\n", sentence.message);
    (void)fflush(stderr);
    (void)MPI_Abort(MPI_COMM_WORLD, status);
    _exit(status);
}

int kiln_agree(MPI_Comm communicator, int status, struct kiln_error *error)
{
    struct {
        int status, rank;
    } own = {status, 0}, worst = {status, 0};
    int ranks = 1;
    if (MPI_Comm_rank(communicator, &own.rank) != MPI_SUCCESS || MPI_Comm_size(communicator, &ranks) != MPI_SUCCESS)
        return lost(error);
    /* On equal values MAXLOC keeps the lowest rank. */
    if (MPI_Allreduce(&own, &worst, 1, MPI_2INT, MPI_MAXLOC, communicator) != MPI_SUCCESS)
        return lost(error);
    if (worst.status == KILN_OK)
        return KILN_OK;
    struct kiln_error sentence = {{0}};
    if (worst.rank == own.rank && error != NULL)
        sentence = *error;
    if (worst.rank == own.rank && worst.status == KILN_SYSTEM && ranks > 1)
        name_rank(&sentence);
    if (MPI_Bcast(&sentence, (int)sizeof sentence, MPI_BYTE, worst.rank, communicator) != MPI_SUCCESS)
        return lost(error);
    if (error != NULL)
        *error = sentence;
    return worst.status;
}
