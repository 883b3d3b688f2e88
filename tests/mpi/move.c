/* Test of kiln_redistribute, run by mpirun on three ranks: an array is redistributed between arbitrary ranges, with
 * messages of any size. */
#include <mpi.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/mpi/redistribute.h"

enum { MOST = 64 };

struct element {
    unsigned char bytes[5];
};

static struct element element_of(uint64_t index)
{
    struct element e;
    for (unsigned i = 0; i < sizeof e.bytes; i++)
        e.bytes[i] = (unsigned char)(index * 7 + i);
    return e;
}

static int try_cuts(int rank, const uint64_t *before, const uint64_t *after, uint64_t limit)
{
    struct element from[MOST], to[MOST];
    memset(to, 0xff, sizeof to);
    for (uint64_t i = before[rank]; i < before[rank + 1]; i++)
        from[i - before[rank]] = element_of(i);
    if (kiln_redistribute(MPI_COMM_WORLD, before, after, sizeof *from, limit, from, to, NULL) != KILN_OK)
        return 1;
    for (uint64_t i = after[rank]; i < after[rank + 1]; i++) {
        const struct element wanted = element_of(i);
        if (memcmp(&to[i - after[rank]], &wanted, sizeof wanted) != 0) {
            (void)fprintf(stderr, "rank %d: element %llu is not what it was\n", rank, (unsigned long long)i);
            return 1;
        }
    }
    const unsigned char behind = to[after[rank + 1] - after[rank]].bytes[0];
    return behind != 0xff; /* nothing is written there */
}

int main(int argc, char **argv)
{
    static const uint64_t cuts[][4] = {{0, 20, 40, 60}, {0, 0, 60, 60}, {0, 59, 60, 60}, {0, 1, 2, 60},
                                       {0, 60, 60, 60}, {0, 0, 0, 60},  {0, 30, 30, 60}};
    static const uint64_t limits[] = {0, 1, 7};
    enum { CUTS = sizeof cuts / sizeof *cuts };
    int rank = 0, size = 0, failures = 0, total = 0;
    MPI_Init(&argc, &argv);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    if (size != 3) {
        (void)fprintf(stderr, "this test wants three ranks, not %d\n", size);
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    for (int b = 0; b < CUTS; b++)
        for (int a = 0; a < CUTS; a++)
            for (size_t l = 0; l < sizeof limits / sizeof *limits; l++)
                failures += try_cuts(rank, cuts[b], cuts[a], limits[l]);
    MPI_Allreduce(&failures, &total, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
    MPI_Finalize();
    return total != 0;
}
