/* The reach of a node: the set of points whose radiosity it receives. Points are grouped into units (patches of
 * surface), each a range of the global order; a node wants a unit or not, and always wants the units of its own ranks.
 * A sender knows which of its units each node wants. Radiosity that a node does not have is marked as absent
 * (worker/scene/radiosity.h), so that a gather that meets it reports it. Private to radiosity_allgather.c, which
 * decides when values are sent. */
#ifndef KILN_COORDINATOR_FIELD_REACH_H
#define KILN_COORDINATOR_FIELD_REACH_H

#include <mpi.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/scene/surface.h"

/* State of a unit on a node. FETCHED: the node is asking for its values right now. NEW: the node has asked for it after
 * the present transfer began, so that its values are sent after the others. */
enum kiln_reach_state { KILN_REACH_ABSENT, KILN_REACH_WANTED, KILN_REACH_NEW, KILN_REACH_FETCHED };

struct kiln_reach {
    uint64_t count;        /* units */
    const uint64_t *first; /* borrowed: first point of each unit, and one more at the end */
    uint8_t *states;       /* of each unit, for this node; the same on all its ranks */
};

/* The range of units that overlap a range of points. */
struct kiln_reach_units {
    uint64_t begin, end;
};
struct kiln_reach_units kiln_reach_units(const struct kiln_reach *reach, uint64_t first, uint64_t count);

/* Wishes of the lane: the states, on its members, of the units of this rank's points. */
struct kiln_reach_asked {
    struct kiln_reach_units units; /* units that overlap this rank's points */
    uint8_t *states;               /* one for each member and each of these units */
};

/* Creates a reach in which all units are absent. KILN_SYSTEM. */
int kiln_reach_create(struct kiln_reach **reach, const uint64_t *first, uint64_t count, struct kiln_error *error);
void kiln_reach_destroy(struct kiln_reach **reach);

/* Collective on the lane: its members tell each other what they want. `limit`: of a message (mpi/exchange.h). `ranges`:
 * of each member its first point and number of points. Frees what `asked` had. KILN_SYSTEM on all members. */
int kiln_reach_tell(const struct kiln_reach *reach, MPI_Comm lane, uint64_t limit, const uint64_t *ranges,
                    struct kiln_reach_asked *asked, struct kiln_error *error);

/* Makes an MPI type that selects the values of those points in [begin, end) whose unit's state is in `mask` (bits 1 <<
 * state). It applies to an array of all points with elements `element` of `size` bytes. `states` begins with that of
 * unit `first`. Returns the number of values; with 0 there is no type. The type is committed; free it with
 * MPI_Type_free. */
uint64_t kiln_reach_type(const struct kiln_reach *reach, const uint8_t *states, uint64_t first, uint32_t mask,
                         uint64_t begin, uint64_t end, MPI_Datatype element, size_t size, MPI_Datatype *type);

/* Replaces each state `from` by `to`, in one array. */
void kiln_reach_replace(uint8_t *states, uint64_t count, enum kiln_reach_state from, enum kiln_reach_state to);

#endif
