/* Surface regression on the device (worker/pass/regression.h). */
#ifndef KILN_WORKER_BACKEND_VULKAN_REGRESSION_H
#define KILN_WORKER_BACKEND_VULKAN_REGRESSION_H

#include "worker/backend/vulkan/vulkan.h"

/* kiln_backend_regress. */
int vulkan_regress(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                   struct kiln_error *error);
/* Releases the buffers kept from one call to the next. */
void vulkan_regression_release(struct vulkan_backend *b);
/* Begins to make its kernels (vulkan_kernels_at_once). */
void vulkan_regression_ahead(struct vulkan_backend *b);

#endif
