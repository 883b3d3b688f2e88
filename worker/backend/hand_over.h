/* The way of results from a backend to the taker of a batch, where the batch may leave out tile runs. */
#ifndef KILN_WORKER_BACKEND_HAND_OVER_H
#define KILN_WORKER_BACKEND_HAND_OVER_H

#include "worker/pass/pass.h"
#include "worker/scene/surface.h"

/* Hands results of the consecutive tile runs [first, first + count) of the surface to the batch's taker, if it has one:
 * all at once if the taker skips those that are left out (kiln_batch.take_some), else stretch by stretch. `results`: of
 * all points of these tile runs, `bytes` each; undefined for those that are left out. Returns the taker's status. */
int kiln_batch_hand_over(const struct kiln_batch *batch, const struct kiln_surface *surface, size_t bytes, size_t first,
                         size_t count, const void *results, struct kiln_error *error);

#endif
