/* Exchange of radiosity between ranks: each rank computes it for its own points, and all ranks gather from all points.
 *
 * A node holds the radiosity of all points once, in memory that its ranks share (node_memory.h). A rank writes its own
 * part directly there, while nobody gathers from it, so within a node nothing is sent. Between nodes, rank i of a node
 * exchanges with the ranks i of all other nodes, its lane (MPI_Iallgatherv), and writes the received values for its
 * whole node. So each value is sent to each node once, all ranks send at the same time, and no rank waits for another
 * of its node. If nodes have unequal numbers of ranks, rank i of a larger node exchanges with rank i modulo n of a
 * smaller node with n ranks.
 *
 * Between bounces values travel while tracing goes on, in 4 bytes (worker/scene/radiosity.h). The points of a rank are
 * divided into a few groups, and a group is sent as soon as its points are computed. The receiver stores it in a second
 * block, 4 bytes a point, until the bounce is over and nobody gathers from the old radiosity any more; then the node's
 * ranks expand it, each a part. A single node has no such block.
 *
 * A node may have a reach: then it receives only the points of wanted units (patches of surface). It always has the
 * units of its own ranks; all others are marked as absent (worker/scene/radiosity.h). Units are only added to the
 * wanted ones: values that exist already are sent at once, and values that are on their way follow at the end. With a
 * reach, messages go between pairs of ranks, with MPI types that select the values in place.
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
    struct kiln_global_point first; /* first own point; the ranks' ranges follow one another and cover all */
    uint64_t count;
    struct kiln_trace *trace; /* may be NULL */
    uint32_t threads;         /* threads that expand received values */
    uint32_t groups;          /* groups in a bounce; 0: chosen by their size */
    uint64_t limit;           /* most elements in a call; 0: the range of int */
};

struct kiln_radiosity_allgather;

/* Collective. If the node has no shared memory left, each of its ranks has its own copy of the radiosity. Destroy with
 * kiln_radiosity_allgather_destroy. */
int kiln_radiosity_allgather_create(struct kiln_radiosity_allgather **allgather,
                                    const struct kiln_radiosity_allgather_params *params, struct kiln_error *error);
/* Collective. The radiosity is freed with it, or with the node memory. */
void kiln_radiosity_allgather_destroy(struct kiln_radiosity_allgather **allgather);

/* Collective, between bounces. Changes the range of own points; the ranges of all ranks still follow one another and
 * cover all points. KILN_SYSTEM on all ranks; without a reach it cannot fail. */
int kiln_radiosity_allgather_set_range(struct kiln_radiosity_allgather *allgather, struct kiln_global_point first,
                                       uint64_t count, struct kiln_error *error);

/* The radiosity of all points, packed, total values. Own values may be written while no rank of the node gathers. */
uint64_t *kiln_radiosity_allgather_values(const struct kiln_radiosity_allgather *allgather);

/* Collective. Sends all radiosity, in 8 bytes, to all nodes, after all ranks have written their own values. */
void kiln_radiosity_allgather_all(struct kiln_radiosity_allgather *allgather);

/* Sets or gets the scale of the 4-byte form; it is the same on all ranks and is set before the first bounce. */
void kiln_radiosity_allgather_set_scale(struct kiln_radiosity_allgather *allgather, double scale);
double kiln_radiosity_allgather_scale(const struct kiln_radiosity_allgather *allgather);

/* The exchange of one bounce. First call begin. Then call advance whenever more values are final: `done` is the number
 * of own values, from the first on, that are final in `next` (in the 4-byte form). Neither waits. When all ranks have
 * advanced to all their values, call finish, collectively: the new values replace the old ones. */
void kiln_radiosity_allgather_begin(struct kiln_radiosity_allgather *allgather);
void kiln_radiosity_allgather_advance(struct kiln_radiosity_allgather *allgather, const uint32_t *next, uint64_t done);
void kiln_radiosity_allgather_finish(struct kiln_radiosity_allgather *allgather, const uint32_t *next);
/* Collective. Cancels a bounce that will not be finished. */
void kiln_radiosity_allgather_abandon(struct kiln_radiosity_allgather *allgather);

/* Bytes that this rank has received from other nodes; and the bytes that it would have received without a reach. */
uint64_t kiln_radiosity_allgather_received(const struct kiln_radiosity_allgather *allgather);
uint64_t kiln_radiosity_allgather_whole(const struct kiln_radiosity_allgather *allgather);

/* ---- the reach ---- */

/* Collective, between bounces. Introduces a reach: from now on nodes receive only wanted units, at first only those of
 * their own ranks. Own values are valid; all other values become absent. `first`: first point of each of `count` units,
 * and one more at the end, borrowed; the same on all ranks. Does nothing if there are no other nodes. After
 * KILN_SYSTEM, which all ranks return, nodes receive all values. */
int kiln_radiosity_allgather_limit(struct kiln_radiosity_allgather *allgather, const uint64_t *first, uint64_t count,
                                   struct kiln_error *error);
/* Collective, between bounces. Removes the reach: nodes receive all values again, from the next exchange on. */
void kiln_radiosity_allgather_unlimit(struct kiln_radiosity_allgather *allgather);

/* This node's state of each unit (enum kiln_reach_state); 0: its points are absent. NULL: there is no reach. */
const uint8_t *kiln_radiosity_allgather_reach(const struct kiln_radiosity_allgather *allgather);

/* Collective, while nobody gathers. Adds wanted units: those for which `wanted` (one byte a unit) is not 0 on any rank
 * of the node; `wanted` becomes this union. With `now` the node receives their present values; else it gets their first
 * values in the next exchange. KILN_SYSTEM on all ranks. */
int kiln_radiosity_allgather_want(struct kiln_radiosity_allgather *allgather, uint8_t *wanted, bool now,
                                  struct kiln_error *error);

/* Collective, between bounces, after kiln_radiosity_allgather_want for the units that the new ranges see. Units are no
 * longer wanted if their `wanted` is 0 (as that call has left it) and no rank of the node owns a part of them.
 * KILN_SYSTEM on all ranks. */
int kiln_radiosity_allgather_drop(struct kiln_radiosity_allgather *allgather, const uint8_t *wanted,
                                  struct kiln_error *error);

/* Collective on the node, with a reach, while no other rank of it gathers. The first sets the values of absent points
 * to mark(context, unit); the second restores the usual mark of all of them (kiln_radiosity_absent). */
void kiln_radiosity_allgather_mark(struct kiln_radiosity_allgather *allgather,
                                   uint64_t (*mark)(const void *context, uint64_t unit), const void *context);
void kiln_radiosity_allgather_mark_absent(struct kiln_radiosity_allgather *allgather);

#endif
