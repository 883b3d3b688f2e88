/* Rooms: sets of surface points between which light can travel, by any number of bounces.
 *
 * A node of the tree of links represents all its points by the visibility of one. So its points must not lie in two
 * unconnected rooms: a sealed box on a lit floor would receive the floor's light. Rays are traced from each point in
 * all directions. Points that they hit are in the same room; a ray without a hit joins the room outdoors. Walls
 * separate rooms for certain. If no ray finds an opening, one room is split in two, which costs links but no light. */
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

/* Collective. Returns the room of each point that sends light, by global index. Rooms are numbered from 0 in the order
 * of their points: the same for any cells and ranks. Points whose rays all hit no point share one room, the last.
 * KILN_SYSTEM and the backend's failures, agreed on. Free *rooms with kiln_free. */
int kiln_rooms_find(const struct kiln_rooms_source *source, uint32_t **rooms, struct kiln_error *error);

#endif
