/* Wrapper of a device's backend that continues with Embree after the device has failed for good: the bake then ends
 * later instead of with an error. It reports this once on stderr. Finished results are kept. A running pass of any kind
 * continues with the first item whose result was not handed over. A failure of the caller's kiln_take_results does not
 * count as a failure of the device. */
#ifndef KILN_WORKER_BACKEND_FALLBACK_H
#define KILN_WORKER_BACKEND_FALLBACK_H

#include "worker/backend/backend.h"

/* Wraps *backend, which becomes the wrapper (and dies with it). On failure *backend is destroyed and NULL. */
int kiln_fallback_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                         struct kiln_error *error);

#endif
