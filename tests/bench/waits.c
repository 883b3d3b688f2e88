/* Loaded into the ranks of a bake (LD_PRELOAD): what they work, without what they spend in calls of MPI that wait for
 * others, which take the processor while they wait. When MPI ends, each rank appends a line to the file that the
 * environment variable WAITS names: its number, seconds of the processor, those of them within such calls. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static _Atomic long long waited; /* ns */

static long long now(clockid_t clock)
{
    struct timespec time;
    (void)clock_gettime(clock, &time);
    return 1000000000ll * time.tv_sec + time.tv_nsec;
}

/* kiln has functions of its own by the names of MPI, for its watchdog, which call these. */
#define WAITS(name, parameters, arguments)                                                                             \
    int PMPI_##name parameters                                                                                         \
    {                                                                                                                  \
        int(*const call) parameters = (int(*) parameters)dlsym(RTLD_NEXT, "PMPI_" #name);                              \
        const long long begin = now(CLOCK_THREAD_CPUTIME_ID);                                                          \
        const int done = call arguments;                                                                               \
        waited += now(CLOCK_THREAD_CPUTIME_ID) - begin;                                                                \
        return done;                                                                                                   \
    }

WAITS(Allgather, (const void *a, int n, MPI_Datatype t, void *b, int m, MPI_Datatype u, MPI_Comm c),
      (a, n, t, b, m, u, c))
WAITS(Allgatherv,
      (const void *a, int n, MPI_Datatype t, void *b, const int *m, const int *at, MPI_Datatype u, MPI_Comm c),
      (a, n, t, b, m, at, u, c))
WAITS(Allreduce, (const void *a, void *b, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c), (a, b, n, t, o, c))
WAITS(Alltoall, (const void *a, int n, MPI_Datatype t, void *b, int m, MPI_Datatype u, MPI_Comm c),
      (a, n, t, b, m, u, c))
WAITS(Alltoallv,
      (const void *a, const int *n, const int *from, MPI_Datatype t, void *b, const int *m, const int *to,
       MPI_Datatype u, MPI_Comm c),
      (a, n, from, t, b, m, to, u, c))
WAITS(Barrier, (MPI_Comm c), (c))
WAITS(Bcast, (void *a, int n, MPI_Datatype t, int r, MPI_Comm c), (a, n, t, r, c))
WAITS(Comm_split, (MPI_Comm c, int color, int key, MPI_Comm *to), (c, color, key, to))
WAITS(Exscan, (const void *a, void *b, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c), (a, b, n, t, o, c))
WAITS(Gather, (const void *a, int n, MPI_Datatype t, void *b, int m, MPI_Datatype u, int r, MPI_Comm c),
      (a, n, t, b, m, u, r, c))
WAITS(Probe, (int r, int tag, MPI_Comm c, MPI_Status *s), (r, tag, c, s))
WAITS(Recv, (void *a, int n, MPI_Datatype t, int r, int tag, MPI_Comm c, MPI_Status *s), (a, n, t, r, tag, c, s))
WAITS(Reduce, (const void *a, void *b, int n, MPI_Datatype t, MPI_Op o, int r, MPI_Comm c), (a, b, n, t, o, r, c))
WAITS(Send, (const void *a, int n, MPI_Datatype t, int r, int tag, MPI_Comm c), (a, n, t, r, tag, c))
WAITS(Test, (MPI_Request * q, int *flag, MPI_Status *s), (q, flag, s))
WAITS(Testall, (int n, MPI_Request *q, int *flag, MPI_Status *s), (n, q, flag, s))
WAITS(Wait, (MPI_Request * q, MPI_Status *s), (q, s))
WAITS(Waitall, (int n, MPI_Request *q, MPI_Status *s), (n, q, s))

int PMPI_Finalize(void)
{
    int rank = 0;
    char line[128];
    const char *path = getenv("WAITS");
    int (*end)(void) = (int (*)(void))dlsym(RTLD_NEXT, "PMPI_Finalize");
    const double own = 1e-9 * (double)now(CLOCK_PROCESS_CPUTIME_ID), inside = 1e-9 * (double)waited;
    (void)PMPI_Comm_rank(MPI_COMM_WORLD, &rank);
    const int file = path != NULL ? open(path, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666) : -1;
    const int size = snprintf(line, sizeof line, "%d %.6f %.6f\n", rank, own, inside);
    if (file >= 0 && write(file, line, (size_t)size) != size)
        (void)fprintf(stderr, "'%s' cannot be written\n", path);
    if (file >= 0)
        (void)close(file);
    return end();
}
