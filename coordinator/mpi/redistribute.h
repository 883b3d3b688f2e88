/* An array over all elements of a global order, of which each rank has a range, goes over to other ranges.
 *
 * Ranges are given by cuts, the same on all ranks: rank r has the elements cuts[r] .. cuts[r + 1] - 1. */
#ifndef KILN_COORDINATOR_MPI_REDISTRIBUTE_H
#define KILN_COORDINATOR_MPI_REDISTRIBUTE_H

#include <mpi.h>
#include <stddef.h>
#include <stdint.h>

/* Collective. What rank r has by the cuts `before` at `from`, it and others have by `after` at `to`, which does not
 * overlap it: elements of `size` bytes, at most `limit` of them in a message (0: what MPI can count), so that any
 * number will do. Ranks without elements in common send each other nothing. */
void kiln_redistribute(MPI_Comm communicator, const uint64_t *before, const uint64_t *after, size_t size,
                       uint64_t limit, const void *from, void *to);

#endif
