/* Node memory: blocks of memory that the ranks of one node share. One of the ranks, the leader, fills a block; all of
 * them can read it (shared_memory.h).
 *
 * All ranks of the node allocate a block together, and it lives until the node memory is destroyed. If one rank cannot
 * map a block (no memory, or a limit of that process), the allocation fails on all ranks of the node, the leader prints
 * the reason, and kiln_node_full returns true from then on. The caller then lets every rank keep a copy of its own. A
 * rank that is alone on its node gets its blocks from kiln_allocate.
 *
 * The leader touches a block first, so its pages lie in the leader's NUMA domain. */
#ifndef KILN_COORDINATOR_MPI_NODE_MEMORY_H
#define KILN_COORDINATOR_MPI_NODE_MEMORY_H

#include <mpi.h>
#include <stdbool.h>
#include <stdint.h>

#include "worker/base/memory.h"

struct kiln_node_memory;

/* Collective over `communicator`. A node consists of all ranks of a host; with `most` not 0 it has at most `most`
 * ranks, consecutive ones of that host. 1 puts every rank into a node of its own. Destroy with kiln_node_destroy. */
int kiln_node_create(struct kiln_node_memory **node, MPI_Comm communicator, uint32_t most, struct kiln_error *error);
/* Collective over the node. Frees all blocks. */
void kiln_node_destroy(struct kiln_node_memory **node);

int kiln_node_rank(const struct kiln_node_memory *node); /* rank within the node; 0: the leader */
int kiln_node_ranks(const struct kiln_node_memory *node);
MPI_Comm kiln_node_communicator(const struct kiln_node_memory *node);
bool kiln_node_full(const struct kiln_node_memory *node);      /* an allocation has failed: share nothing more */
uint64_t kiln_node_bytes(const struct kiln_node_memory *node); /* of all blocks; they exist once in the node */

/* Collective over the node. Allocates a zeroed block of count x size bytes; *pointer receives its address on this rank.
 * `what` names it in error messages. All ranks of the node get the same status. */
int kiln_node_region(struct kiln_node_memory *node, void *pointer, size_t count, size_t size, const char *what,
                     struct kiln_error *error);

/* Collective over the node. The leader runs build(context, memory, error); what that allocates from `memory` becomes
 * blocks. Meanwhile the other ranks sleep and take part in these allocations. All ranks get the leader's status and
 * message. After the call all ranks see what the leader wrote. */
typedef int (*kiln_node_builder)(void *context, const struct kiln_allocator *memory, struct kiln_error *error);
int kiln_node_build(struct kiln_node_memory *node, kiln_node_builder build, void *context, struct kiln_error *error);
/* An allocator for the leader inside kiln_node_build, with the node as its context. Releasing a block only sets the
 * pointer to NULL. */
struct kiln_allocator kiln_node_allocator(struct kiln_node_memory *node);
/* Not collective. Translates the address `there` at which a block begins on the leader into the address at which it
 * begins on this rank; NULL if no block begins there. `node` is a const struct kiln_node_memory. */
void *kiln_node_place(const void *node, const void *there);

/* Rank regions: an array of regions, one owned by each rank of the node and readable and writable by all of them.
 * Unlike the node's they can be freed. kiln_node_bytes does not count them, since they are counted with each rank. The
 * pages of one lie in its owner's NUMA domain. */
struct kiln_rank_regions;
/* Collective over the node. Allocates a zeroed region of `bytes` for this rank and maps those of the other ranks. All
 * ranks get the same status: KILN_SYSTEM if one of them cannot allocate its region or map another; the leader then
 * prints the reason, and kiln_node_full does not change. With `node` NULL the call is not collective, and this rank's
 * region is the only one. Destroy with kiln_rank_regions_destroy. */
int kiln_rank_regions_create(struct kiln_rank_regions **parts, struct kiln_node_memory *node, uint64_t bytes,
                             const char *what, struct kiln_error *error);
/* Collective over the node. */
void kiln_rank_regions_destroy(struct kiln_rank_regions **parts);
/* The region of rank `rank` of the node. If they were created with `node` NULL, the only one is that of rank 0. */
void *kiln_rank_region(const struct kiln_rank_regions *parts, int rank);

/* Collective over the node. Copies `size` bytes at `data` from the leader to all ranks. */
void kiln_node_broadcast(const struct kiln_node_memory *node, void *data, size_t size);
/* Collective over the node. A barrier and memory fence: what a rank wrote to blocks before it is visible to all ranks
 * after it. Ranks that wait sleep. */
void kiln_node_wait(const struct kiln_node_memory *node);

#endif
