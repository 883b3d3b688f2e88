/* Memory that the ranks of one node share: blocks that one of them, the leader, fills and all see (shared_memory.h).
 *
 * Blocks are made by all ranks of the node together, and live until the node memory is destroyed. When one of them
 * cannot have a block (no memory, a limit of its own), making it fails on all ranks of the node alike, the leader says
 * why, and kiln_node_full says so from then on: what was to be shared is then made by every rank for itself. A rank
 * alone on its node shares with nobody: its blocks come from kiln_allocate.
 *
 * A block has the page placement of who touches it first, the leader. */
#ifndef KILN_COORDINATOR_MPI_NODE_MEMORY_H
#define KILN_COORDINATOR_MPI_NODE_MEMORY_H

#include <mpi.h>
#include <stdbool.h>
#include <stdint.h>

#include "worker/base/memory.h"

struct kiln_node_memory;

/* Collective. A node is a host's ranks or, with `most` not 0, at most so many of them: one socket's, or with 1 every
 * rank alone. Destroy with kiln_node_destroy. */
int kiln_node_create(struct kiln_node_memory **node, MPI_Comm communicator, uint32_t most, struct kiln_error *error);
/* Collective. Frees all blocks. */
void kiln_node_destroy(struct kiln_node_memory **node);

int kiln_node_rank(const struct kiln_node_memory *node); /* 0: the leader */
int kiln_node_ranks(const struct kiln_node_memory *node);
MPI_Comm kiln_node_communicator(const struct kiln_node_memory *node);
bool kiln_node_full(const struct kiln_node_memory *node);
uint64_t kiln_node_bytes(const struct kiln_node_memory *node); /* of all blocks: once a node */

/* Collective on the node. A zeroed block of count x size bytes at *pointer on each of its ranks. All get the same
 * status. */
int kiln_node_block(struct kiln_node_memory *node, void *pointer, size_t count, size_t size, const char *what,
                    struct kiln_error *error);

/* Collective on the node. The leader runs build(context, memory, error), whose allocations from `memory` become blocks;
 * the others wait, asleep most of the time, and take part in these. All get the leader's status and sentence. What the
 * leader wrote is seen by all. */
typedef int (*kiln_node_builder)(void *context, const struct kiln_allocator *memory, struct kiln_error *error);
int kiln_node_build(struct kiln_node_memory *node, kiln_node_builder build, void *context, struct kiln_error *error);
/* Whose blocks these are; releasing one does nothing but set the pointer to NULL. Its context is the node. */
struct kiln_allocator kiln_node_allocator(struct kiln_node_memory *node);
/* Where the block that begins at `there` on the leader begins here; NULL for another address. `node`: const struct
 * kiln_node_memory. */
void *kiln_node_place(const void *node, const void *there);

/* Memory of which each rank of a node has a part, and all see all parts. Unlike blocks it can be given back;
 * kiln_node_bytes leaves it out, for it is each rank's own. A part has the page placement of its owner. */
struct kiln_node_parts;
/* Collective on the node. A zeroed part of `bytes` for this rank; all get the same status, KILN_SYSTEM when one of them
 * cannot have its part or see another's (which does not make the node full; the leader says why). With `node` NULL not
 * collective: this rank's part is all there is. Destroy with kiln_node_parts_destroy. */
int kiln_node_parts_create(struct kiln_node_parts **parts, struct kiln_node_memory *node, uint64_t bytes,
                           const char *what, struct kiln_error *error);
/* Collective on the node. */
void kiln_node_parts_destroy(struct kiln_node_parts **parts);
/* The part of the node's rank `rank`; with `node` NULL of rank 0. */
void *kiln_node_part(const struct kiln_node_parts *parts, int rank);

/* Collective on the node. `size` bytes of the leader's at `data` to all. */
void kiln_node_broadcast(const struct kiln_node_memory *node, void *data, size_t size);
/* Collective on the node. What each rank wrote to blocks before is seen by all after. */
void kiln_node_wait(const struct kiln_node_memory *node);

#endif
