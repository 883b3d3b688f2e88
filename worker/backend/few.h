/* Batches in which some points take fewer samples than the others (kiln_selection), for backends that support one
 * number of samples an item: run as two batches, whose results are combined. */
#ifndef KILN_WORKER_BACKEND_FEW_H
#define KILN_WORKER_BACKEND_FEW_H

#include "worker/backend/backend.h"

/* As kiln_backend_run, for a valid batch over tile runs with selections. Results of the points with fewer samples are
 * stored until the others are ready. */
int kiln_backend_run_few(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                         const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);

#endif
