/* Radiosity between ranks: everybody gets everybody's share. */
#ifndef KILN_COORDINATOR_BAKE_EXCHANGE_H
#define KILN_COORDINATOR_BAKE_EXCHANGE_H

#include <mpi.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Collective. `all` holds `total` values on every rank, of which this rank has filled [first, first + count); the ranks'
 * ranges follow one another in rank order and cover all. On return `all` is whole everywhere. Counts beyond 2^31 are sent in
 * parts. */
int kiln_exchange(MPI_Comm communicator, uint64_t *all, uint64_t total, uint64_t first, uint64_t count, struct kiln_error *error);

#endif
