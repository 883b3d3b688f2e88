/* Radiosity between ranks: each computes its own points' and all gather from everybody's.
 *
 * A node holds the radiosity of all points once, in memory that its ranks share (node_memory.h). A rank writes its own
 * part straight there, when nobody gathers from it, so within a node nothing is sent. Between nodes rank i of a node
 * speaks with the ranks i of all other nodes, its lane (MPI_Iallgatherv), and what it receives it writes for its whole
 * node: each value crosses to each node once, all ranks send at the same time, and no rank waits for another of its
 * node. Where nodes have unequal numbers of ranks, rank i of the larger ones speaks with rank i modulo their number of
 * the smaller ones.
 *
 * Between bounces values travel while tracing goes on, in 4 bytes (worker/scene/radiosity.h): a rank's share is cut
 * into a few groups of points, and a group leaves as soon as its points are computed. It waits on the other side in a
 * second block, 4 bytes a point, until the bounce is over and nobody gathers from the old radiosity any more; the
 * node's ranks then expand it, each a part. Nodes that are alone have no such block.
 *
 * A node may have a reach: then it receives only the points of units (patches of surface) that it wants. Those of its
 * own ranks it always has; the others are marked as absent (worker/scene/radiosity.h). What is wanted is only ever
 * added to: values that are already there come at once, and those that are on their way follow at the end. The messages
 * are those of pairs of ranks then, with types that pick the values out where they stand.
 *
 * Counts and displacements of MPI are int. Within a limit (2^31 - 1 points) a group is one collective call; beyond, one
 * broadcast for each rank's part, in pieces. */
#ifndef KILN_COORDINATOR_FIELD_RADIOSITY_ALLGATHER_H
#define KILN_COORDINATOR_FIELD_RADIOSITY_ALLGATHER_H

#include <stdint.h>

#include "coordinator/mpi/node_memory.h"
#include "coordinator/run/trace.h"
#include "worker/scene/surface.h"

struct kiln_radiosity_allgather_params {
    MPI_Comm communicator;
    struct kiln_node_memory *node;  /* of the same communicator; borrowed */
    uint64_t total;                 /* points of all ranks */
    struct kiln_global_point first; /* own points: the ranks' ranges follow one another and cover all */
    uint64_t count;
    struct kiln_trace *trace; /* may be NULL */
    uint32_t threads;         /* that expand what has arrived */
    uint32_t groups;          /* a bounce; 0: chosen by their size */
    uint64_t limit;           /* of elements in a call; 0: what int holds */
};

struct kiln_radiosity_allgather;

/* Collective. When the node has no shared memory left, its ranks have the radiosity each for itself. Destroy with
 * kiln_radiosity_allgather_destroy. */
int kiln_radiosity_allgather_create(struct kiln_radiosity_allgather **allgather,
                                    const struct kiln_radiosity_allgather_params *params, struct kiln_error *error);
/* Collective. The radiosity goes with it, or with the node memory. */
void kiln_radiosity_allgather_destroy(struct kiln_radiosity_allgather **allgather);

/* Collective, between bounces. Own points are others from now on; the ranges still follow one another and cover all.
 * KILN_SYSTEM on all ranks; without a reach it cannot fail. */
int kiln_radiosity_allgather_set_range(struct kiln_radiosity_allgather *allgather, struct kiln_global_point first,
                                       uint64_t count, struct kiln_error *error);

/* The radiosity of all points, packed, total values. Own values may be written while no rank of the node gathers. */
uint64_t *kiln_radiosity_allgather_values(const struct kiln_radiosity_allgather *allgather);

/* Collective. All ranks have written their own values, in 8 bytes: everybody gets all. */
void kiln_radiosity_allgather_all(struct kiln_radiosity_allgather *allgather);

/* Scale of the 4-byte form, the same on all ranks: set before the first bounce. */
void kiln_radiosity_allgather_set_scale(struct kiln_radiosity_allgather *allgather, double scale);
double kiln_radiosity_allgather_scale(const struct kiln_radiosity_allgather *allgather);

/* One bounce. Begin; then, as often as there is news, how many own values from the first on are final in `next` (values
 * in the 4-byte form); then, collectively, when all ranks have said that all are, finish: the values replace the old
 * ones. None of the first two waits. */
void kiln_radiosity_allgather_begin(struct kiln_radiosity_allgather *allgather);
void kiln_radiosity_allgather_advance(struct kiln_radiosity_allgather *allgather, const uint32_t *next, uint64_t done);
void kiln_radiosity_allgather_finish(struct kiln_radiosity_allgather *allgather, const uint32_t *next);
/* Collective. Ends a bounce that is not to be finished. */
void kiln_radiosity_allgather_abandon(struct kiln_radiosity_allgather *allgather);

/* Bytes that this rank has received from other nodes; and that it would have received without a reach. */
uint64_t kiln_radiosity_allgather_received(const struct kiln_radiosity_allgather *allgather);
uint64_t kiln_radiosity_allgather_whole(const struct kiln_radiosity_allgather *allgather);

/* ---- the reach ---- */

/* Collective, between bounces. From now on nodes receive what they want; at first what is their own. Own values are
 * there; of the others none is believed. `first`: first point of each of `count` units, and one more at the end,
 * borrowed; the same on all ranks. Without other nodes it does nothing. KILN_SYSTEM on all ranks, and nodes receive
 * all.
 */
int kiln_radiosity_allgather_limit(struct kiln_radiosity_allgather *allgather, const uint64_t *first, uint64_t count,
                                   struct kiln_error *error);
/* Collective, between bounces. Nodes receive all again: with the next exchange. */
void kiln_radiosity_allgather_unlimit(struct kiln_radiosity_allgather *allgather);

/* How this node stands to each unit, 0: its points are absent. NULL: there is no reach. */
const uint8_t *kiln_radiosity_allgather_reach(const struct kiln_radiosity_allgather *allgather);

/* Collective, while nobody gathers. The node wants the units for which `wanted` (one byte a unit, which becomes the
 * node's) is not 0 on any of its ranks, from now on. `now`: it receives their present values; else those of the next
 * exchange are the first. KILN_SYSTEM on all ranks. */
int kiln_radiosity_allgather_want(struct kiln_radiosity_allgather *allgather, uint8_t *wanted, bool now,
                                  struct kiln_error *error);

/* Collective, between bounces, after it was asked for what the new ranges see: units that no rank of the node has a
 * part in, and for which `wanted` is 0 (as kiln_radiosity_allgather_want has left it), are not wanted any more.
 * KILN_SYSTEM on all ranks. */
int kiln_radiosity_allgather_drop(struct kiln_radiosity_allgather *allgather, const uint8_t *wanted,
                                  struct kiln_error *error);

/* Collective on the node, with a reach, while no other rank of it gathers. The values of absent points become
 * mark(context, unit); the second puts the mark of all back (kiln_radiosity_absent). */
void kiln_radiosity_allgather_mark(struct kiln_radiosity_allgather *allgather,
                                   uint64_t (*mark)(const void *context, uint64_t unit), const void *context);
void kiln_radiosity_allgather_mark_absent(struct kiln_radiosity_allgather *allgather);

#endif
