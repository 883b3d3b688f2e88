/* Redistribution of an array among ranks: each rank holds a contiguous range of the elements of a global order, and
 * afterwards holds another range.
 *
 * Ranges are given by their bounds, the same on all ranks: rank r holds the elements bounds[r] .. bounds[r + 1] - 1. */
#ifndef KILN_COORDINATOR_MPI_REDISTRIBUTE_H
#define KILN_COORDINATOR_MPI_REDISTRIBUTE_H

#include <mpi.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Collective over `communicator`. Rank r has its range by the bounds `before` at `from` and receives its range by the
 * bounds `after` at `to`, which must not overlap `from`. An element has `size` bytes. A message has at most `limit`
 * elements (exchange.h), so ranges may be longer than INT_MAX. Only ranks whose old and new ranges intersect exchange
 * messages. KILN_SYSTEM on all ranks. */
int kiln_redistribute(MPI_Comm communicator, const uint64_t *before, const uint64_t *after, size_t size, uint64_t limit,
                      const void *from, void *to, struct kiln_error *error);

#endif
