/* Run by mpirun on two ranks. Values that are the same pass; where one rank has another value, both learn of it, with a
 * sentence that has both. With the argument `differ` an array is moved between ranges that the ranks do not agree on:
 * the checks of debug builds, which this file and the tests' copy of redistribute.c have in every build, end both. */
#undef NDEBUG
#include <mpi.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/mpi/assert_same.h"
#include "coordinator/mpi/redistribute.h"

/* Whether what this rank and the other bring gives the status, and the sentence both values. */
static int wrong(uint64_t own, int wanted, const char *least, const char *most)
{
    struct kiln_error error = {{0}};
    const int status = kiln_same(MPI_COMM_WORLD, own, "the number of goats", &error);
    return status != wanted ||
           (wanted != KILN_OK && (strstr(error.message, "goats") == NULL || strstr(error.message, least) == NULL ||
                                  strstr(error.message, most) == NULL));
}

static int check_values(uint64_t rank)
{
    int failures = wrong(7, KILN_OK, "", "") + wrong(0, KILN_OK, "", "") + wrong(UINT64_MAX, KILN_OK, "", "");
    failures += wrong(7 + rank, KILN_BUG, "from 7", "to 8");
    failures += wrong(rank == 0 ? UINT64_MAX : 0, KILN_BUG, "from 0", "to 18446744073709551615");
    kiln_assert_same(MPI_COMM_WORLD, 3, "three");
    kiln_assert_same_bytes(MPI_COMM_WORLD, "abc", 3, "letters");
    kiln_assert_same_bytes(MPI_COMM_WORLD, NULL, 0, "nothing");
    return failures;
}

int main(int argc, char **argv)
{
    static const uint64_t halves[] = {0, 2, 4}, thirds[] = {0, 1, 4};
    const char from[4] = {0};
    char to[4];
    int rank = 0, total = 0;
    MPI_Init(&argc, &argv);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    const int failures = check_values((uint64_t)rank);
    MPI_Allreduce(&failures, &total, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
    kiln_redistribute(MPI_COMM_WORLD, halves, halves, 1, 0, from, to);
    if (argc > 1 && strcmp(argv[1], "differ") == 0) {
        kiln_redistribute(MPI_COMM_WORLD, halves, rank == 0 ? halves : thirds, 1, 0, from, to);
        (void)fprintf(stderr, "rank %d: nobody noticed\n", rank);
    }
    MPI_Finalize();
    return total != 0;
}
