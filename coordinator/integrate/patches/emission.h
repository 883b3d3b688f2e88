/* Light traced from the lights by all ranks, for the energy ledger (energy.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_EMISSION_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_EMISSION_H

#include <mpi.h>

#include "worker/backend/backend.h"
#include "worker/backend/emission.h"

/* Collective. Traces KILN_EMISSION_SAMPLES particles, distributed over the ranks. Every rank gets the same bits, with
 * any number of ranks. */
int kiln_trace_emission(MPI_Comm communicator, struct kiln_backend *backend, struct kiln_emission_result *result,
                        struct kiln_error *error);

#endif
