/* A backend that goes on with Embree once its device has failed for good: the bake ends later, not with an error. It
 * says so on stderr, once. What the device has finished is kept; a pass that is under way, whichever it is, goes on
 * with the first item that has not been handed over. A caller's own failure, returned by its kiln_take_results, is no
 * failure of the device. */
#ifndef KILN_WORKER_BACKEND_FALLBACK_H
#define KILN_WORKER_BACKEND_FALLBACK_H

#include "worker/backend/backend.h"

/* Wraps *backend, which becomes the wrapper (and dies with it). On failure *backend is destroyed and NULL. */
int kiln_fallback_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                         struct kiln_error *error);

#endif
