/* Light traced from the lights (kiln_backend_emission, backend.h) in parts, of which several processes can have some
 * each. */
#ifndef KILN_WORKER_BACKEND_EMISSION_H
#define KILN_WORKER_BACKEND_EMISSION_H

#include "worker/backend/backend.h"

/* Independent groups of particles, whose spread tells the error. */
enum { KILN_EMISSION_GROUPS = 16 };

/* About `samples` particles in all groups. Of these traces `first` and each `step`-th after it, and leaves the others
 * at 0. */
int kiln_emission_groups(struct kiln_backend *backend, uint32_t samples, uint32_t first, uint32_t step,
                         struct kiln_emission_result groups[KILN_EMISSION_GROUPS], struct kiln_error *error);
/* The means of all groups, and their standard errors. */
void kiln_emission_combine(const struct kiln_emission_result groups[KILN_EMISSION_GROUPS],
                           struct kiln_emission_result *result);

#endif
