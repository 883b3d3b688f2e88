/* The device that takes noise out of lightmaps (worker/pass/regression.h), for many threads, each with a lightmap of
 * its own. A small lightmap keeps a device at work for less time than it takes to tell it so. What waits while the
 * device is at work therefore goes to it together, as one surface. Results are those of each lightmap alone, bit for
 * bit: a point's hang on the points of its own cells only. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_REGRESSION_DEVICE_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_REGRESSION_DEVICE_H

#include "worker/backend/backend.h"
#include "worker/pass/regression.h"

struct kiln_regression_device;

/* Borrows the backend, which nobody else may use while a work runs. KILN_SYSTEM. */
int kiln_regression_device_create(struct kiln_regression_device **device, struct kiln_backend *backend,
                                  struct kiln_error *error);
void kiln_regression_device_destroy(struct kiln_regression_device **device);

/* As kiln_backend_regress; from any thread. `give` and `take` of a small work are called by this thread, of a large one
 * perhaps by another meanwhile. All works of a device have the same number of lights. */
int kiln_regression_device_run(struct kiln_regression_device *device, const struct kiln_regression_work *work,
                               bool *done, struct kiln_error *error);

#endif
