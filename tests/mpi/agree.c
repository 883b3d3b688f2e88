/* Test of kiln_agree, run by mpirun on three ranks: whatever status each rank passes, all return the worst one with the
 * message of the first rank that has it, which names rank and host if the failure is local. */
#include <mpi.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/mpi/agree.h"

static int wrong(int rank, int status, const char *message, int wanted, const char *sentence)
{
    if (status == wanted && strcmp(message, sentence) == 0)
        return 0;
    (void)fprintf(stderr, "rank %d: got %d \"%s\", not %d \"%s\"\n", rank, status, message, wanted, sentence);
    return 1;
}

int main(int argc, char **argv)
{
    static const struct {
        int brought[3], wanted, speaker, named;
    } cases[] = {{{0, 0, 0}, 0, -1, 0},
                 {{0, 0, KILN_IO}, KILN_IO, 2, 1},
                 {{KILN_BAD_INPUT, KILN_IO, KILN_IO}, KILN_IO, 1, 1},
                 {{65, 65, 65}, 65, 0, 0},
                 {{KILN_IO, 0, 0}, KILN_IO, 0, 1},
                 {{0, KILN_STOPPED, KILN_USAGE}, KILN_STOPPED, 1, 0},
                 {{0, KILN_SYSTEM, 0}, KILN_SYSTEM, 1, 1},
                 {{KILN_SYSTEM, KILN_SYSTEM, KILN_SYSTEM}, KILN_SYSTEM, 0, 0}};
    int rank = 0, size = 0, failures = 0, total = 0;
    MPI_Init(&argc, &argv);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    if (size != 3) {
        (void)fprintf(stderr, "this test wants three ranks, not %d\n", size);
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct kiln_error error = {"nothing happened"};
        char sentence[160] = "nothing happened", host[64] = "";
        (void)gethostname(host, sizeof host - 1);
        if (cases[i].brought[rank] != 0)
            (void)kiln_fail(&error, cases[i].brought[rank], "case %zu, rank %d", i, rank);
        if (cases[i].speaker >= 0)
            (void)snprintf(sentence, sizeof sentence, "rank %d on %s: case %zu, rank %d", cases[i].speaker, host, i,
                           cases[i].speaker);
        const char *wanted = cases[i].speaker >= 0 && !cases[i].named ? strstr(sentence, "case") : sentence;
        const int status = kiln_agree(MPI_COMM_WORLD, cases[i].brought[rank], &error);
        failures += wrong(rank, status, error.message, cases[i].wanted, wanted);
        /* A rank that passes no buffer for the message takes part all the same. */
        failures += kiln_agree(MPI_COMM_WORLD, cases[i].brought[rank], rank == 2 ? NULL : &error) != cases[i].wanted;
    }
    MPI_Allreduce(&failures, &total, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
    MPI_Finalize();
    return total != 0;
}
