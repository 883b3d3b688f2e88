#include "coordinator/mpi/node_memory.h"

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "coordinator/mpi/shared_memory.h"
#include "coordinator/mpi/waiting.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"

struct region {
    uint64_t shared;   /* size of its shared memory, bytes; 0: it is from kiln_allocate */
    void *here;        /* address on this rank */
    const void *there; /* address on the leader */
};

struct kiln_node_memory {
    MPI_Comm communicator;
    int rank, ranks;
    bool full;   /* kiln_node_full */
    bool warned; /* the reason has been printed */
    uint64_t bytes;
    struct region *regions;
    size_t count, room;
};

/* A message from the leader to the ranks that wait in kiln_node_build. */
struct call {
    int64_t end;    /* not 0: the build is over */
    uint64_t bytes; /* otherwise: size of the block to allocate together */
};

int kiln_node_create(struct kiln_node_memory **node, MPI_Comm communicator, uint32_t most, struct kiln_error *error)
{
    struct kiln_node_memory *n = NULL;
    *node = NULL;
    kiln_assert_same(communicator, most, "the number of ranks that share memory");
    const int status = kiln_agree(communicator, kiln_allocate(&n, 1, sizeof *n, "the memory of a node", error), error);
    if (status != KILN_OK) {
        kiln_free(&n);
        return status;
    }
    MPI_Comm host;
    (void)MPI_Comm_split_type(communicator, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &host);
    (void)MPI_Comm_rank(host, &n->rank);
    (void)MPI_Comm_split(host, most > 0 ? n->rank / (int)most : 0, 0, &n->communicator);
    (void)MPI_Comm_free(&host);
    (void)MPI_Comm_rank(n->communicator, &n->rank);
    (void)MPI_Comm_size(n->communicator, &n->ranks);
    *node = n;
    return KILN_OK;
}

void kiln_node_destroy(struct kiln_node_memory **node)
{
    struct kiln_node_memory *n = *node;
    if (n == NULL)
        return;
    for (size_t i = n->count; i > 0; i--) {
        struct region *b = &n->regions[i - 1];
        if (b->shared != 0)
            kiln_shared_release(&b->here, b->shared);
        else
            kiln_free(&b->here);
    }
    kiln_free(&n->regions);
    (void)MPI_Comm_free(&n->communicator);
    kiln_free(node);
}

int kiln_node_rank(const struct kiln_node_memory *node) { return node->rank; }
int kiln_node_ranks(const struct kiln_node_memory *node) { return node->ranks; }
MPI_Comm kiln_node_communicator(const struct kiln_node_memory *node) { return node->communicator; }
bool kiln_node_full(const struct kiln_node_memory *node) { return node->full; }
uint64_t kiln_node_bytes(const struct kiln_node_memory *node) { return node->bytes; }

/* Prints, once for each node, why memory is not shared. */
static void warn_not_shared(struct kiln_node_memory *n, const struct kiln_error *why)
{
    if (n->rank == 0 && !n->warned)
        (void)fprintf(stderr,
                      "kiln: warning: the ranks of this host cannot share memory; each keeps its own copy, which takes "
                      "more memory: %s\n",
                      why->message);
    n->warned = true;
}

/* Collective over the node. The leader allocates shared memory and the other ranks map it; all get the same status. */
static int open_block(const struct kiln_node_memory *n, uint64_t bytes, struct region *region, struct kiln_error *error)
{
    struct kiln_shared_key key = {0};
    const int made = n->rank == 0 ? kiln_shared_make(&region->here, &key, bytes, error) : KILN_OK;
    int status = kiln_agree(n->communicator, made, error);
    if (status == KILN_OK) {
        struct kiln_shared_key leader = key;
        (void)MPI_Bcast(&leader, (int)sizeof leader, MPI_BYTE, 0, n->communicator);
        status = kiln_agree(n->communicator, n->rank != 0 ? kiln_shared_open(&region->here, &leader, error) : KILN_OK,
                            error);
    }
    kiln_shared_seal(&key);
    if (status != KILN_OK)
        kiln_shared_release(&region->here, bytes);
    region->shared = bytes;
    return status;
}

static int add_block(struct kiln_node_memory *n, const struct region *region, uint64_t bytes)
{
    n->regions[n->count++] = *region; /* make_block has made room */
    n->bytes += bytes;
    return KILN_OK;
}

static int make_own_block(struct kiln_node_memory *n, uint64_t bytes, void **here, struct kiln_error *error)
{
    struct region region = {0};
    const int status = kiln_allocate(&region.here, bytes, 1, "the memory of a node", error);
    *here = region.here;
    region.there = region.here;
    return status == KILN_OK ? add_block(n, &region, bytes) : status;
}

/* Collective over the node; `bytes` is the same on all ranks. */
static int make_block(struct kiln_node_memory *n, uint64_t bytes, void **here, struct kiln_error *error)
{
    struct region region = {0};
    struct kiln_error why = {{0}};
    int status = kiln_grow(&n->regions, &n->room, n->count + 1, sizeof *n->regions, "the blocks of a node", &why);
    if (n->ranks == 1)
        return status == KILN_OK ? make_own_block(n, bytes, here, error) : kiln_fail(error, status, "%s", why.message);
    status = kiln_agree(n->communicator, status, &why);
    if (status == KILN_OK && n->full)
        return kiln_fail(error, KILN_SYSTEM, "the ranks of this host share no memory");
    if (status == KILN_OK)
        status = open_block(n, bytes, &region, &why);
    if (status != KILN_OK) {
        n->full = true;
        warn_not_shared(n, &why);
        return kiln_fail(error, status, "%s", why.message);
    }
    uint64_t there = (uint64_t)(uintptr_t)region.here;
    (void)MPI_Bcast(&there, 1, MPI_UINT64_T, 0, n->communicator);
    region.there = (const void *)(uintptr_t)there;
    *here = region.here;
    return add_block(n, &region, bytes);
}

/* Computes the size of a block: a multiple of 64, at least 64, so that an empty block has an address of its own,
 * too. */
static int bytes_of(size_t count, size_t size, const char *what, uint64_t *bytes, struct kiln_error *error)
{
    if (size != 0 && count > SIZE_MAX / 2 / size)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: %zu elements of %zu bytes for %s", count, size, what);
    *bytes = (count * size + 64) / 64 * 64;
    return KILN_OK;
}

int kiln_node_region(struct kiln_node_memory *node, void *pointer, size_t count, size_t size, const char *what,
                     struct kiln_error *error)
{
    uint64_t bytes = 0;
    void *here = NULL;
    int status = bytes_of(count, size, what, &bytes, error);
    kiln_assert_same(node->communicator, bytes, what);
    if (status == KILN_OK)
        status = make_block(node, bytes, &here, error);
    memcpy(pointer, &here, sizeof here);
    if (status == KILN_OK)
        kiln_node_wait(node);
    return status;
}

/* ---- regions ---- */

struct kiln_rank_regions {
    int ranks;
    bool is_shared; /* false: the only region is from kiln_allocate */
    struct {
        void *at;
        uint64_t bytes;
    } part[]; /* one for each rank */
};

/* Collective over the node. Each rank allocates its own region and maps those of the others. */
static int open_parts(const struct kiln_node_memory *n, struct kiln_rank_regions *p, uint64_t bytes,
                      struct kiln_shared_key *keys, struct kiln_error *error)
{
    struct kiln_shared_key own = {0};
    int status = kiln_agree(n->communicator, kiln_shared_make(&p->part[n->rank].at, &own, bytes, error), error);
    p->part[n->rank].bytes = bytes;
    if (status == KILN_OK) {
        (void)MPI_Allgather(&own, (int)sizeof own, MPI_BYTE, keys, (int)sizeof own, MPI_BYTE, n->communicator);
        for (int r = 0; r < n->ranks && status == KILN_OK; r++) {
            if (r != n->rank)
                status = kiln_shared_open(&p->part[r].at, &keys[r], error);
            p->part[r].bytes = keys[r].bytes;
        }
        status = kiln_agree(n->communicator, status, error);
    }
    kiln_shared_seal(&own);
    return status;
}

static void close_parts(struct kiln_rank_regions *p)
{
    for (int r = 0; r < p->ranks; r++)
        kiln_shared_release(&p->part[r].at, p->part[r].bytes);
}

/* Collective over the node. */
static int share_parts(struct kiln_node_memory *n, struct kiln_rank_regions *p, uint64_t bytes, const char *what,
                       struct kiln_error *error)
{
    struct kiln_shared_key *keys = NULL;
    struct kiln_error why = {{0}};
    int status = p != NULL ? kiln_allocate(&keys, (size_t)n->ranks, sizeof *keys, what, &why)
                           : kiln_fail(&why, KILN_SYSTEM, "out of memory: %s", what);
    status = kiln_agree(n->communicator, status, &why);
    if (status == KILN_OK) {
        status = open_parts(n, p, bytes, keys, &why);
        if (status != KILN_OK)
            close_parts(p);
    }
    kiln_free(&keys);
    if (status == KILN_OK)
        return KILN_OK;
    warn_not_shared(n, &why);
    return kiln_fail(error, status, "%s", why.message);
}

int kiln_rank_regions_create(struct kiln_rank_regions **parts, struct kiln_node_memory *node, uint64_t bytes,
                             const char *what, struct kiln_error *error)
{
    const int ranks = node != NULL ? node->ranks : 1;
    struct kiln_rank_regions *p = NULL;
    bytes = (bytes + 64) / 64 * 64;
    int status = kiln_allocate(&p, 1, sizeof *p + (size_t)ranks * sizeof *p->part, what, error);
    if (status == KILN_OK) {
        p->ranks = ranks;
        p->is_shared = ranks > 1;
    }
    if (ranks > 1)
        status = share_parts(node, p, bytes, what, error);
    else if (status == KILN_OK)
        status = kiln_allocate(&p->part[0].at, bytes, 1, what, error);
    if (status != KILN_OK)
        kiln_free(&p);
    *parts = p;
    return status;
}

void kiln_rank_regions_destroy(struct kiln_rank_regions **parts)
{
    struct kiln_rank_regions *p = *parts;
    if (p == NULL)
        return;
    if (p->is_shared)
        close_parts(p);
    else
        kiln_free(&p->part[0].at);
    kiln_free(parts);
}

void *kiln_rank_region(const struct kiln_rank_regions *parts, int rank) { return parts->part[rank].at; }

/* ---- building ---- */

/* Leader: sends the message to the ranks that wait in attend(). */
static void send_call(const struct kiln_node_memory *n, struct call *call)
{
    MPI_Request request;
    if (n->ranks == 1)
        return;
    (void)MPI_Ibcast(call, sizeof *call, MPI_BYTE, 0, n->communicator, &request);
    (void)MPI_Wait(&request, MPI_STATUS_IGNORE);
}

/* kiln_allocator.allocate, called on the leader while the other ranks are in attend(). */
static int allocate_here(void *context, void *pointer, size_t count, size_t size, const char *what,
                         struct kiln_error *error)
{
    struct kiln_node_memory *n = context;
    struct call call = {0};
    void *here = NULL;
    int status = bytes_of(count, size, what, &call.bytes, error);
    if (status == KILN_OK) {
        send_call(n, &call);
        status = make_block(n, call.bytes, &here, error);
    }
    memcpy(pointer, &here, sizeof here);
    return status;
}

/* Implements kiln_allocator.release: only clears the pointer; the block is freed with the node memory. */
static void forget_pointer(void *context, void *pointer)
{
    (void)context;
    void *none = NULL;
    memcpy(pointer, &none, sizeof none);
}

struct kiln_allocator kiln_node_allocator(struct kiln_node_memory *node)
{
    return (struct kiln_allocator){.allocate = allocate_here, .release = forget_pointer, .context = node};
}

/* Waits asleep, since the leader may use all cores meanwhile. */
static void sleep_until(MPI_Request *request)
{
    struct timespec pause = {0, 20000};
    int complete = 0;
    kiln_waiting_begin("a wait for the ranks of its host");
    for (;;) {
        (void)MPI_Test(request, &complete, MPI_STATUS_IGNORE);
        if (complete != 0)
            break;
        (void)nanosleep(&pause, NULL);
        if (pause.tv_nsec < 2000000)
            pause.tv_nsec += pause.tv_nsec / 2;
    }
    kiln_waiting_end();
}

/* Takes part in the allocations of the leader until its build is over. */
static void attend(struct kiln_node_memory *n)
{
    struct call call;
    for (;;) {
        MPI_Request request;
        void *here;
        (void)MPI_Ibcast(&call, sizeof call, MPI_BYTE, 0, n->communicator, &request);
        sleep_until(&request);
        if (call.end != 0)
            return;
        (void)make_block(n, call.bytes, &here, NULL);
    }
}

int kiln_node_build(struct kiln_node_memory *node, kiln_node_builder build, void *context, struct kiln_error *error)
{
    int status = KILN_OK;
    if (node->rank == 0) {
        const struct kiln_allocator memory = kiln_node_allocator(node);
        status = build(context, &memory, error);
        struct call last = {.end = 1};
        send_call(node, &last);
    } else {
        attend(node);
    }
    if (node->ranks > 1)
        status = kiln_agree(node->communicator, status, error);
    kiln_node_wait(node);
    return status;
}

void *kiln_node_place(const void *node, const void *there)
{
    const struct kiln_node_memory *n = node;
    for (size_t i = 0; i < n->count; i++)
        if (n->regions[i].there == there)
            return n->regions[i].here;
    return NULL;
}

void kiln_node_broadcast(const struct kiln_node_memory *node, void *data, size_t size)
{
    kiln_assert_same(node->communicator, size, "the bytes that a node's leader passes on");
    if (node->ranks > 1)
        (void)MPI_Bcast(data, (int)size, MPI_BYTE, 0, node->communicator);
}

void kiln_node_wait(const struct kiln_node_memory *node)
{
    if (node->ranks == 1)
        return;
    atomic_thread_fence(memory_order_seq_cst);
    MPI_Request request;
    (void)MPI_Ibarrier(node->communicator, &request);
    sleep_until(&request);
    atomic_thread_fence(memory_order_seq_cst);
}
