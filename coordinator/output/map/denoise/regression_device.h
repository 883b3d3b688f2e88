/* Queue for the device that denoises lightmaps (worker/pass/regression.h), shared by many threads, each with a lightmap
 * of its own. A small lightmap takes less device time than its submission. So all lightmaps that wait while the device
 * is busy are submitted together, as one surface. Results are the same bits as for each lightmap alone, since a point's
 * result depends only on the points of its own cells. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_REGRESSION_DEVICE_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_REGRESSION_DEVICE_H

#include "worker/backend/backend.h"
#include "worker/pass/regression.h"

struct kiln_regression_device;

/* Borrows the backend, which nobody else may use while work runs. KILN_SYSTEM. */
int kiln_regression_device_create(struct kiln_regression_device **device, struct kiln_backend *backend,
                                  struct kiln_error *error);
void kiln_regression_device_destroy(struct kiln_regression_device **device);

/* Runs one lightmap, like kiln_backend_regress; from any thread. `give` and `take` are called by this thread if the
 * work is small, and perhaps by another thread meanwhile if it is large. All work of a device has the same number of
 * lights. */
int kiln_regression_device_run(struct kiln_regression_device *device, const struct kiln_regression_work *work,
                               bool *done, struct kiln_error *error);

#endif
