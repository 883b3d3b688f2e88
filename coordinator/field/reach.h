/* The reach of a node: of which points it receives the radiosity. Points are told apart by units (patches of surface),
 * each a range of the global order; a node wants a unit or it does not, and always wants those of its own ranks. Who
 * sends knows what each node wants of it. What a node does not have is marked as absent (worker/scene/radiosity.h), so
 * that a gather that meets it says so. Private to radiosity_allgather.c, which says when what is sent. */
#ifndef KILN_COORDINATOR_FIELD_REACH_H
#define KILN_COORDINATOR_FIELD_REACH_H

#include <mpi.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/scene/surface.h"

/* How a node stands to a unit. FETCHED: it asks for it just now. NEW: it has asked since the values that are on their
 * way began to travel, so that they will be sent after the others. */
enum kiln_reach_state { KILN_REACH_ABSENT, KILN_REACH_WANTED, KILN_REACH_NEW, KILN_REACH_FETCHED };

struct kiln_reach {
    uint64_t count;        /* units */
    const uint64_t *first; /* borrowed: first point of each unit, and one more at the end */
    uint8_t *states;       /* of each unit, for this node; the same on all its ranks */
};

/* A range of units that a range of points has a part in. */
struct kiln_reach_units {
    uint64_t begin, end;
};
struct kiln_reach_units kiln_reach_units(const struct kiln_reach *reach, uint64_t first, uint64_t count);

/* The lane's part: what its members want of this rank's points. */
struct kiln_reach_asked {
    struct kiln_reach_units units; /* that this rank has a part in */
    uint8_t *states;               /* of each member, for each of these */
};

/* KILN_SYSTEM. All units are absent. */
int kiln_reach_create(struct kiln_reach **reach, const uint64_t *first, uint64_t count, struct kiln_error *error);
void kiln_reach_destroy(struct kiln_reach **reach);

/* Collective on the lane: its members tell each other what they want. `limit`: of a message (mpi/exchange.h). `ranges`:
 * of each member its first point and number of points. Frees what `asked` had. KILN_SYSTEM on all members. */
int kiln_reach_tell(const struct kiln_reach *reach, MPI_Comm lane, uint64_t limit, const uint64_t *ranges,
                    struct kiln_reach_asked *asked, struct kiln_error *error);

/* Makes a type of MPI of the values of the points [begin, end) whose unit's state is in `mask` (bits 1 << state), in an
 * array of all points of elements `element` of `size` bytes. `states` begins with that of unit `first`. Returns the
 * number of values; with 0 there is no type. Commits it; to be freed with MPI_Type_free. */
uint64_t kiln_reach_type(const struct kiln_reach *reach, const uint8_t *states, uint64_t first, uint32_t mask,
                         uint64_t begin, uint64_t end, MPI_Datatype element, size_t size, MPI_Datatype *type);

/* Replaces states: from -> to, in one array. */
void kiln_reach_replace(uint8_t *states, uint64_t count, enum kiln_reach_state from, enum kiln_reach_state to);

#endif
