/* A batch of which some points take fewer samples than the others (kiln_selection), for backends that know one
 * number of samples an item: two batches, whose results are put together. */
#ifndef KILN_WORKER_BACKEND_FEW_H
#define KILN_WORKER_BACKEND_FEW_H

#include "worker/backend/backend.h"

/* As kiln_backend_run, of a well-formed batch over tile runs with selections. Keeps the results of the points with
 * fewer samples until the others have theirs. */
int kiln_backend_run_few(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                         const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);

#endif
