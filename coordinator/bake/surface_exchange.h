/* How the ranks that build a surface speak with one another, over MPI.
 *
 * What goes to everybody goes in rounds: each brings the same share of what it has in each, so that a round needs
 * little memory on the other side and its counts fit MPI's int. What goes to one rank goes in as many messages as that
 * takes. */
#ifndef KILN_COORDINATOR_BAKE_SURFACE_EXCHANGE_H
#define KILN_COORDINATOR_BAKE_SURFACE_EXCHANGE_H

#include <mpi.h>

#include "coordinator/surface/surface_build.h"

struct kiln_surface_meeting {
    MPI_Comm communicator;
    size_t limit; /* bytes of a round, and of a message; 0: 32 MiB. At least a record, whatever it says */
};

/* The meeting is borrowed, for as long as the result is used. */
struct kiln_surface_exchange kiln_surface_exchange_over(struct kiln_surface_meeting *meeting);

#endif
