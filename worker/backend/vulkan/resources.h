/* Resources that the backend is given (worker/backend/resources.h), as they lie on the device. */
#ifndef KILN_WORKER_BACKEND_VULKAN_RESOURCES_H
#define KILN_WORKER_BACKEND_VULKAN_RESOURCES_H

#include "worker/backend/vulkan/vulkan.h"

/* Brings a resource to the device, in the place of what was there. */
int vulkan_resource_bring(struct vulkan_backend *b, enum kiln_resource_index index, struct kiln_error *error);
/* Brings all resources that the backend was given to its device, after the device was made anew. */
int vulkan_resources_bring(struct vulkan_backend *b, struct kiln_error *error);
/* Gives back what lies on the device of any. */
void vulkan_resources_release(struct vulkan_backend *b);

#endif
