/* MPI communication for the construction of the surface (surface_build.h declares the interface).
 *
 * An allgather runs in rounds: in each round every rank contributes the same fraction of its records, so that a round
 * needs little memory for the received records and its counts fit an int. An exchange between pairs of ranks uses as
 * many messages as it needs. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_SURFACE_EXCHANGE_H
#define KILN_COORDINATOR_BAKE_POINTS_SURFACE_EXCHANGE_H

#include <mpi.h>

#include "coordinator/surface/surface_build.h"

struct kiln_surface_meeting {
    MPI_Comm communicator;
    size_t limit; /* bytes of a round, and of a message; 0: 32 MiB. A round has at least one record in any case */
};

/* `meeting` is borrowed as long as the result is used. */
struct kiln_surface_exchange kiln_surface_exchange_over(struct kiln_surface_meeting *meeting);

#endif
