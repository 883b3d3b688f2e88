#include "coordinator/mpi/waiting.h"

#include <mpi.h>
#include <stdatomic.h>
#include <stdbool.h>

/* State of the present wait. It is global because the intercepted MPI calls have no argument for it. The tracked thread
 * writes it; any thread may read it. */
static struct {
    _Atomic(const char *) call;
    _Atomic uint64_t steps, bytes;
} present;
static _Thread_local bool tracked;
static _Thread_local int depth;              /* of nested calls */
static _Thread_local uint64_t pending_bytes; /* bytes of messages started since the last synchronizing call */

void kiln_waiting_follow(void) { tracked = true; }

static void step(void)
{
    atomic_store_explicit(&present.steps, atomic_load_explicit(&present.steps, memory_order_relaxed) + 1,
                          memory_order_relaxed);
}

static void begin(const char *call, uint64_t bytes)
{
    if (!tracked || depth++ > 0)
        return;
    atomic_store_explicit(&present.bytes, bytes + pending_bytes, memory_order_relaxed);
    step();
    atomic_store_explicit(&present.call, call, memory_order_release);
}

/* Ends an intercepted call. `synchronizes`: no rank leaves the call before all have entered it, so messages started
 * before have arrived. */
static int end(int result, bool synchronizes)
{
    if (!tracked || --depth > 0)
        return result;
    if (synchronizes)
        pending_bytes = 0;
    atomic_store_explicit(&present.call, NULL, memory_order_relaxed);
    step();
    return result;
}

static int started(int result, uint64_t bytes)
{
    if (tracked)
        pending_bytes += bytes;
    return result;
}

static int tested(int result, const int *found)
{
    if (tracked && *found != 0)
        step();
    return result;
}

void kiln_waiting_begin(const char *call) { begin(call, 0); }
void kiln_waiting_end(void) { (void)end(0, false); }

void kiln_waiting_look(struct kiln_waiting *waiting)
{
    waiting->call = atomic_load_explicit(&present.call, memory_order_acquire);
    waiting->steps = atomic_load_explicit(&present.steps, memory_order_relaxed);
    waiting->bytes = atomic_load_explicit(&present.bytes, memory_order_relaxed);
}

/* ---- the intercepted MPI calls ---- */

static uint64_t bytes_of(int64_t count, MPI_Datatype type)
{
    int size = 0;
    if (count <= 0 || type == MPI_DATATYPE_NULL || PMPI_Type_size(type, &size) != MPI_SUCCESS || size < 0)
        return 0;
    return (uint64_t)count * (uint64_t)size;
}

static int64_t ranks_of(MPI_Comm communicator)
{
    int ranks = 1;
    (void)PMPI_Comm_size(communicator, &ranks);
    return ranks;
}

static uint64_t bytes_of_all(const int *counts, MPI_Datatype type, MPI_Comm communicator)
{
    const int64_t ranks = ranks_of(communicator);
    int64_t sum = 0;
    for (int64_t r = 0; r < ranks; r++)
        sum += counts[r];
    return bytes_of(sum, type);
}

/* Defines a call that may block: its declared parameters, its arguments, the bytes that it transfers, and whether it
 * synchronizes all ranks. */
#define WAITS(name, parameters, arguments, bytes, synchronizes)                                                        \
    int MPI_##name parameters                                                                                          \
    {                                                                                                                  \
        begin("MPI_" #name, bytes);                                                                                    \
        return end(PMPI_##name arguments, synchronizes);                                                               \
    }
/* Define a call that begins a non-blocking operation, and one that tests for its completion. */
#define STARTS(name, parameters, arguments, bytes)                                                                     \
    int MPI_##name parameters { return started(PMPI_##name arguments, bytes); }
#define TESTS(name, parameters, arguments, found)                                                                      \
    int MPI_##name parameters { return tested(PMPI_##name arguments, found); }

WAITS(Barrier, (MPI_Comm comm), (comm), 0, true)
WAITS(Bcast, (void *buffer, int count, MPI_Datatype type, int root, MPI_Comm comm), (buffer, count, type, root, comm),
      bytes_of(count, type), false)
WAITS(Allreduce, (const void *send, void *receive, int count, MPI_Datatype type, MPI_Op op, MPI_Comm comm),
      (send, receive, count, type, op, comm), 2 * bytes_of(count, type), true)
WAITS(Reduce, (const void *send, void *receive, int count, MPI_Datatype type, MPI_Op op, int root, MPI_Comm comm),
      (send, receive, count, type, op, root, comm), 2 * bytes_of(count, type), false)
WAITS(Exscan, (const void *send, void *receive, int count, MPI_Datatype type, MPI_Op op, MPI_Comm comm),
      (send, receive, count, type, op, comm), 2 * bytes_of(count, type), false)
WAITS(Gather,
      (const void *send, int count, MPI_Datatype type, void *receive, int counted, MPI_Datatype as, int root,
       MPI_Comm comm),
      (send, count, type, receive, counted, as, root, comm), bytes_of(count *ranks_of(comm), type), false)
WAITS(Allgather,
      (const void *send, int count, MPI_Datatype type, void *receive, int counted, MPI_Datatype as, MPI_Comm comm),
      (send, count, type, receive, counted, as, comm), bytes_of(counted *ranks_of(comm), as), true)
WAITS(Allgatherv,
      (const void *send, int count, MPI_Datatype type, void *receive, const int counts[], const int places[],
       MPI_Datatype as, MPI_Comm comm),
      (send, count, type, receive, counts, places, as, comm), bytes_of_all(counts, as, comm), true)
WAITS(Alltoall,
      (const void *send, int count, MPI_Datatype type, void *receive, int counted, MPI_Datatype as, MPI_Comm comm),
      (send, count, type, receive, counted, as, comm), 2 * bytes_of(counted * ranks_of(comm), as), true)
WAITS(Alltoallv,
      (const void *send, const int sent[], const int from[], MPI_Datatype type, void *receive, const int counts[],
       const int to[], MPI_Datatype as, MPI_Comm comm),
      (send, sent, from, type, receive, counts, to, as, comm),
      bytes_of_all(sent, type, comm) + bytes_of_all(counts, as, comm), true)
WAITS(Send, (const void *buffer, int count, MPI_Datatype type, int to, int tag, MPI_Comm comm),
      (buffer, count, type, to, tag, comm), bytes_of(count, type), false)
WAITS(Recv, (void *buffer, int count, MPI_Datatype type, int from, int tag, MPI_Comm comm, MPI_Status *status),
      (buffer, count, type, from, tag, comm, status), bytes_of(count, type), false)
WAITS(Sendrecv,
      (const void *send, int count, MPI_Datatype type, int to, int tag, void *receive, int counted, MPI_Datatype as,
       int from, int tags, MPI_Comm comm, MPI_Status *status),
      (send, count, type, to, tag, receive, counted, as, from, tags, comm, status),
      bytes_of(count, type) + bytes_of(counted, as), false)
WAITS(Probe, (int from, int tag, MPI_Comm comm, MPI_Status *status), (from, tag, comm, status), 0, false)
WAITS(Wait, (MPI_Request * request, MPI_Status *status), (request, status), 0, false)
WAITS(Waitall, (int count, MPI_Request requests[], MPI_Status statuses[]), (count, requests, statuses), 0, false)
WAITS(Comm_dup, (MPI_Comm comm, MPI_Comm *copy), (comm, copy), 0, true)
WAITS(Comm_split, (MPI_Comm comm, int color, int key, MPI_Comm *part), (comm, color, key, part), 0, true)
WAITS(Comm_split_type, (MPI_Comm comm, int type, int key, MPI_Info info, MPI_Comm *part), (comm, type, key, info, part),
      0, true)
WAITS(Comm_free, (MPI_Comm * comm), (comm), 0, false)
WAITS(Finalize, (void), (), 0, false)

STARTS(Isend, (const void *buffer, int count, MPI_Datatype type, int to, int tag, MPI_Comm comm, MPI_Request *request),
       (buffer, count, type, to, tag, comm, request), bytes_of(count, type))
STARTS(Irecv, (void *buffer, int count, MPI_Datatype type, int from, int tag, MPI_Comm comm, MPI_Request *request),
       (buffer, count, type, from, tag, comm, request), bytes_of(count, type))
STARTS(Ibcast, (void *buffer, int count, MPI_Datatype type, int root, MPI_Comm comm, MPI_Request *request),
       (buffer, count, type, root, comm, request), bytes_of(count, type))
STARTS(Iallgatherv,
       (const void *send, int count, MPI_Datatype type, void *receive, const int counts[], const int places[],
        MPI_Datatype as, MPI_Comm comm, MPI_Request *request),
       (send, count, type, receive, counts, places, as, comm, request), bytes_of_all(counts, as, comm))

TESTS(Test, (MPI_Request * request, int *found, MPI_Status *status), (request, found, status), found)
TESTS(Testall, (int count, MPI_Request requests[], int *found, MPI_Status statuses[]),
      (count, requests, found, statuses), found)
