#include "coordinator/mpi/agree.h"

#include <stdbool.h>
#include <stdio.h>
#include <unistd.h>

static int lost(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST,
                     "a rank was lost while the ranks compared their results; run the same command again");
}

/* Adds the prefix "rank N on HOST: ". All ranks get the same message, so it must tell the rank. */
static void add_prefix(struct kiln_error *error)
{
    const struct kiln_error given = *error;
    char host[64] = "";
    int rank, named;
    if (MPI_Comm_rank(MPI_COMM_WORLD, &rank) != MPI_SUCCESS || sscanf(given.message, "rank %d on ", &named) == 1)
        return;
    (void)gethostname(host, sizeof host - 1);
    (void)kiln_fail(error, KILN_SYSTEM, "rank %d on %s: %s", rank, host, given.message);
}

/* Whether failures with this status are caused by a single rank or its host; all others concern the whole job. */
static bool is_local_failure(int status)
{
    switch (status) {
    case KILN_NO_INPUT:
    case KILN_NO_DEVICE:
    case KILN_BUG:
    case KILN_SYSTEM:
    case KILN_CANNOT_CREATE:
    case KILN_IO:
    case KILN_PERMISSION:
    case KILN_SITE:
        return true;
    default:
        return false;
    }
}

void kiln_name_rank(int status, struct kiln_error *error)
{
    if (is_local_failure(status))
        add_prefix(error);
}

void kiln_end_all_ranks(int status, const struct kiln_error *error)
{
    struct kiln_error named = *error;
    add_prefix(&named);
    (void)fprintf(stderr, "kiln: error: %s\n", named.message);
    (void)fflush(stderr);
    (void)MPI_Abort(MPI_COMM_WORLD, status);
    _exit(status);
}

int kiln_agree(MPI_Comm communicator, int status, struct kiln_error *error)
{
    struct {
        int status, rank;
    } own[2] = {{status, 0}, {-status, 0}}, most[2] = {{status, 0}, {-status, 0}};
    int rank = 0;
    if (MPI_Comm_rank(communicator, &rank) != MPI_SUCCESS)
        return lost(error);
    own[0].rank = own[1].rank = rank;
    /* The first pair gives the worst status, the second the best. MAXLOC keeps the lowest rank among equal values. */
    if (MPI_Allreduce(own, most, 2, MPI_2INT, MPI_MAXLOC, communicator) != MPI_SUCCESS)
        return lost(error);
    const int worst = most[0].status, best = -most[1].status;
    if (worst == KILN_OK)
        return KILN_OK;
    struct kiln_error shared = {{0}};
    if (most[0].rank == rank && error != NULL)
        shared = *error;
    if (most[0].rank == rank && best != worst)
        kiln_name_rank(worst, &shared);
    if (MPI_Bcast(&shared, (int)sizeof shared, MPI_BYTE, most[0].rank, communicator) != MPI_SUCCESS)
        return lost(error);
    if (error != NULL)
        *error = shared;
    return worst;
}
