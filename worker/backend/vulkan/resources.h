/* Upload of resources that the backend is given (worker/backend/resources.h). */
#ifndef KILN_WORKER_BACKEND_VULKAN_RESOURCES_H
#define KILN_WORKER_BACKEND_VULKAN_RESOURCES_H

#include "worker/backend/vulkan/vulkan.h"

/* Uploads a resource, replacing the previous one. */
int vulkan_resource_bring(struct vulkan_backend *b, enum kiln_resource_index index, struct kiln_error *error);
/* Uploads all resources that the backend was given, after the device was set up again. */
int vulkan_resources_bring(struct vulkan_backend *b, struct kiln_error *error);
/* Releases the device memory of all resources. */
void vulkan_resources_release(struct vulkan_backend *b);

#endif
