/* Rooms: which surface points light can go between at all, by any number of bounces.
 *
 * A node of the tree of links stands for all its points by what one of them is seen of. So none may have points of two
 * rooms that nothing joins: a sealed box that stands on a lit floor would have the floor's light. From each point rays
 * go around it, and what they meet is in its room, or, where they meet nothing, outdoors, which is a room, too. Walls
 * part rooms for certain; that two parts are one room is missed where none of the rays finds the way, which costs
 * links and no light. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_ROOMS_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_LINK_ROOMS_H

#include <mpi.h>

#include "worker/backend/backend.h"
#include "worker/pass/patches.h"

/* Input of the search for rooms. All borrowed. */
struct kiln_rooms_source {
    MPI_Comm communicator; /* of all ranks, which have the surface's points among them */
    const struct kiln_surface *surface;
    struct kiln_backend *backend;    /* has that surface */
    const struct kiln_patch *points; /* of all surface points, by global index */
};

/* Collective. Room of each point that sends light, by global index, from 0 on, in the order of the points' numbers: the
 * same for any cells and ranks. Points of whose rays none has found a point are one room together, the last.
 * KILN_SYSTEM and the backend's failures, agreed on. Free *rooms with kiln_free. */
int kiln_rooms_find(const struct kiln_rooms_source *source, uint32_t **rooms, struct kiln_error *error);

#endif
