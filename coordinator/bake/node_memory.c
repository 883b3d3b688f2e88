#include "coordinator/bake/node_memory.h"

#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <time.h>

#include "coordinator/cli/agree.h"

/* Where Open MPI's shared windows lie; what is left there for others. */
#define SHARED_FOLDER "/dev/shm"
enum { SPARE_BYTES = 16 << 20 };

struct block {
    MPI_Win window; /* MPI_WIN_NULL: from kiln_allocate */
    void *here;
    const void *there; /* on the leader */
};

struct kiln_node_memory {
    MPI_Comm communicator;
    int rank, ranks;
    bool full;
    uint64_t bytes;
    struct block *blocks;
    size_t count, room;
};

/* What the leader has for those who wait. */
struct call {
    int64_t end;
    int64_t status;
    uint64_t bytes;
};

int kiln_node_create(struct kiln_node_memory **node, MPI_Comm communicator, uint32_t most, struct kiln_error *error)
{
    struct kiln_node_memory *n = NULL;
    *node = NULL;
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
    (void)MPI_Comm_set_errhandler(n->communicator, MPI_ERRORS_RETURN); /* a window that cannot be had is no reason to die */
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
        struct block *b = &n->blocks[i - 1];
        if (b->window == MPI_WIN_NULL) {
            kiln_free(&b->here);
            continue;
        }
        (void)MPI_Win_unlock_all(b->window);
        (void)MPI_Win_free(&b->window);
    }
    kiln_free(&n->blocks);
    (void)MPI_Comm_free(&n->communicator);
    kiln_free(node);
}

int kiln_node_rank(const struct kiln_node_memory *node) { return node->rank; }
int kiln_node_ranks(const struct kiln_node_memory *node) { return node->ranks; }
MPI_Comm kiln_node_communicator(const struct kiln_node_memory *node) { return node->communicator; }
bool kiln_node_full(const struct kiln_node_memory *node) { return node->full; }
uint64_t kiln_node_bytes(const struct kiln_node_memory *node) { return node->bytes; }

/* Whether the leader may ask for so much: a window beyond what the file system has would be granted, and kill the process that writes to it. */
static bool has_room(uint64_t bytes)
{
    struct statvfs system;
    if (getenv("OMPI_MCA_osc_sm_backing_directory") != NULL || statvfs(SHARED_FOLDER, &system) != 0)
        return true;
    return (uint64_t)system.f_bavail * system.f_frsize >= bytes + SPARE_BYTES;
}

/* Collective. A window of the leader's `bytes`; false, on all ranks, when one of them gets none. */
static bool open_window(const struct kiln_node_memory *n, uint64_t bytes, struct block *block)
{
    void *own = NULL;
    int unit = 1, good = MPI_Win_allocate_shared(n->rank == 0 ? (MPI_Aint)bytes : 0, 1, MPI_INFO_NULL, n->communicator, &own, &block->window) ==
                         MPI_SUCCESS;
    (void)MPI_Allreduce(MPI_IN_PLACE, &good, 1, MPI_INT, MPI_LAND, n->communicator);
    if (good == 0)
        return false;
    MPI_Aint size;
    (void)MPI_Win_shared_query(block->window, 0, &size, &unit, &block->here);
    (void)MPI_Win_lock_all(MPI_MODE_NOCHECK, block->window);
    return true;
}

static int add_block(struct kiln_node_memory *n, const struct block *block, uint64_t bytes)
{
    n->blocks[n->count++] = *block; /* there is room: see make_block */
    n->bytes += bytes;
    return KILN_OK;
}

/* Collective, with the leader's `bytes` the same on all. */
static int make_block(struct kiln_node_memory *n, uint64_t bytes, void **here, struct kiln_error *error)
{
    struct block block = {.window = MPI_WIN_NULL};
    int status = kiln_grow(&n->blocks, &n->room, n->count + 1, sizeof *n->blocks, "the blocks of a node", error);
    if (n->ranks == 1) {
        if (status == KILN_OK)
            status = kiln_allocate(&block.here, bytes, 1, "the memory of a node", error);
        *here = block.here;
        block.there = block.here;
        return status == KILN_OK ? add_block(n, &block, bytes) : status;
    }
    status = kiln_agree(n->communicator, status, error);
    if (status != KILN_OK)
        return status;
    int64_t room = n->rank == 0 && !n->full && has_room(bytes);
    (void)MPI_Bcast(&room, 1, MPI_INT64_T, 0, n->communicator);
    if (room == 0 || !open_window(n, bytes, &block)) {
        n->full = true;
        return kiln_fail(error, KILN_SYSTEM, "the node has no shared memory for another %llu bytes: enlarge " SHARED_FOLDER,
                         (unsigned long long)bytes);
    }
    if (n->rank == 0)
        memset(block.here, 0, bytes);
    uint64_t there = (uint64_t)(uintptr_t)block.here;
    (void)MPI_Bcast(&there, 1, MPI_UINT64_T, 0, n->communicator);
    block.there = (const void *)(uintptr_t)there;
    *here = block.here;
    return add_block(n, &block, bytes);
}

/* At least a byte, so that blocks of nothing have addresses too. */
static int bytes_of(size_t count, size_t size, const char *what, uint64_t *bytes, struct kiln_error *error)
{
    if (size != 0 && count > SIZE_MAX / 2 / size)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: %zu elements of %zu bytes for %s", count, size, what);
    *bytes = (count * size + 64) / 64 * 64;
    return KILN_OK;
}

int kiln_node_block(struct kiln_node_memory *node, void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error)
{
    uint64_t bytes = 0;
    void *here = NULL;
    int status = bytes_of(count, size, what, &bytes, error);
    if (status == KILN_OK)
        status = make_block(node, bytes, &here, error);
    memcpy(pointer, &here, sizeof here);
    if (status == KILN_OK)
        kiln_node_wait(node);
    return status;
}

/* ---- parts ---- */

struct kiln_node_parts {
    MPI_Win window; /* MPI_WIN_NULL: from kiln_allocate */
    void *part[];   /* one a rank */
};

/* Collective. Whether the leader finds room for all ranks' parts. */
static bool parts_have_room(const struct kiln_node_memory *n, uint64_t bytes)
{
    (void)MPI_Allreduce(MPI_IN_PLACE, &bytes, 1, MPI_UINT64_T, MPI_SUM, n->communicator);
    int64_t room = n->rank == 0 && has_room(bytes);
    (void)MPI_Bcast(&room, 1, MPI_INT64_T, 0, n->communicator);
    return room != 0;
}

/* Collective. */
static bool open_parts(const struct kiln_node_memory *n, struct kiln_node_parts *p, uint64_t bytes)
{
    MPI_Info info;
    void *own = NULL;
    (void)MPI_Info_create(&info);
    (void)MPI_Info_set(info, "alloc_shared_noncontig", "true");
    int good = MPI_Win_allocate_shared((MPI_Aint)bytes, 1, info, n->communicator, &own, &p->window) == MPI_SUCCESS;
    (void)MPI_Info_free(&info);
    (void)MPI_Allreduce(MPI_IN_PLACE, &good, 1, MPI_INT, MPI_LAND, n->communicator);
    if (good == 0)
        return false;
    for (int r = 0; r < n->ranks; r++) {
        MPI_Aint size;
        int unit;
        (void)MPI_Win_shared_query(p->window, r, &size, &unit, &p->part[r]);
    }
    (void)MPI_Win_lock_all(MPI_MODE_NOCHECK, p->window);
    memset(p->part[n->rank], 0, bytes);
    return true;
}

int kiln_node_parts_create(struct kiln_node_parts **parts, const struct kiln_node_memory *node, uint64_t bytes, const char *what,
                           struct kiln_error *error)
{
    const int ranks = node != NULL ? node->ranks : 1;
    struct kiln_node_parts *p = NULL;
    bytes = (bytes + 64) / 64 * 64;
    int status = kiln_allocate(&p, 1, sizeof *p + (size_t)ranks * sizeof *p->part, what, error);
    if (status == KILN_OK)
        p->window = MPI_WIN_NULL;
    if (status == KILN_OK && ranks == 1)
        status = kiln_allocate(&p->part[0], bytes, 1, what, error);
    if (ranks > 1)
        status = kiln_agree(node->communicator, status, error);
    if (status == KILN_OK && ranks > 1 && (!parts_have_room(node, bytes) || !open_parts(node, p, bytes)))
        status = kiln_fail(error, KILN_SYSTEM, "the node has no shared memory for %s: enlarge " SHARED_FOLDER, what);
    if (status != KILN_OK)
        kiln_free(&p);
    *parts = p;
    return status;
}

void kiln_node_parts_destroy(struct kiln_node_parts **parts)
{
    struct kiln_node_parts *p = *parts;
    if (p == NULL)
        return;
    if (p->window == MPI_WIN_NULL) {
        kiln_free(&p->part[0]);
    } else {
        (void)MPI_Win_unlock_all(p->window);
        (void)MPI_Win_free(&p->window);
    }
    kiln_free(parts);
}

void *kiln_node_part(const struct kiln_node_parts *parts, int rank) { return parts->part[rank]; }

/* ---- building ---- */

/* The leader's word to those who wait for it with the same call. */
static void tell(const struct kiln_node_memory *n, struct call *call)
{
    MPI_Request request;
    if (n->ranks == 1)
        return;
    (void)MPI_Ibcast(call, sizeof *call, MPI_BYTE, 0, n->communicator, &request);
    (void)MPI_Wait(&request, MPI_STATUS_IGNORE);
}

/* kiln_allocator.allocate, on the leader while the others attend. */
static int allocate_here(void *context, void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error)
{
    struct kiln_node_memory *n = context;
    struct call call = {0};
    void *here = NULL;
    int status = bytes_of(count, size, what, &call.bytes, error);
    if (status == KILN_OK) {
        tell(n, &call);
        status = make_block(n, call.bytes, &here, error);
    }
    memcpy(pointer, &here, sizeof here);
    return status;
}

static void release_later(void *context, void *pointer)
{
    (void)context;
    void *none = NULL;
    memcpy(pointer, &none, sizeof none);
}

struct kiln_allocator kiln_node_allocator(struct kiln_node_memory *node)
{
    return (struct kiln_allocator){.allocate = allocate_here, .release = release_later, .context = node};
}

/* The leader may want all cores meanwhile: nobody spins. */
static void sleep_until(MPI_Request *request)
{
    struct timespec pause = {0, 20000};
    for (int complete = 0;;) {
        (void)MPI_Test(request, &complete, MPI_STATUS_IGNORE);
        if (complete != 0)
            return;
        (void)nanosleep(&pause, NULL);
        if (pause.tv_nsec < 2000000)
            pause.tv_nsec += pause.tv_nsec / 2;
    }
}

/* Takes part in what the leader does; gives its status. */
static int attend(struct kiln_node_memory *n)
{
    struct call call;
    for (;;) {
        MPI_Request request;
        void *here;
        (void)MPI_Ibcast(&call, sizeof call, MPI_BYTE, 0, n->communicator, &request);
        sleep_until(&request);
        if (call.end != 0)
            return (int)call.status;
        (void)make_block(n, call.bytes, &here, NULL);
    }
}

int kiln_node_build(struct kiln_node_memory *node, kiln_node_builder build, void *context, struct kiln_error *error)
{
    int status;
    if (node->rank == 0) {
        const struct kiln_allocator memory = kiln_node_allocator(node);
        status = build(context, &memory, error);
        struct call last = {.end = 1, .status = status};
        tell(node, &last);
    } else {
        status = attend(node);
    }
    struct kiln_error sentence = {{0}};
    if (status != KILN_OK && error != NULL)
        sentence = *error;
    kiln_node_broadcast(node, &sentence, sizeof sentence);
    if (status != KILN_OK && error != NULL)
        *error = sentence;
    kiln_node_wait(node);
    return status;
}

void *kiln_node_place(const void *node, const void *there)
{
    const struct kiln_node_memory *n = node;
    for (size_t i = 0; i < n->count; i++)
        if (n->blocks[i].there == there)
            return n->blocks[i].here;
    return NULL;
}

void kiln_node_broadcast(const struct kiln_node_memory *node, void *data, size_t size)
{
    if (node->ranks > 1)
        (void)MPI_Bcast(data, (int)size, MPI_BYTE, 0, node->communicator);
}

void kiln_node_wait(const struct kiln_node_memory *node)
{
    if (node->ranks == 1)
        return;
    for (size_t i = 0; i < node->count; i++)
        if (node->blocks[i].window != MPI_WIN_NULL)
            (void)MPI_Win_sync(node->blocks[i].window);
    MPI_Request request;
    (void)MPI_Ibarrier(node->communicator, &request);
    sleep_until(&request);
    for (size_t i = 0; i < node->count; i++)
        if (node->blocks[i].window != MPI_WIN_NULL)
            (void)MPI_Win_sync(node->blocks[i].window);
}
