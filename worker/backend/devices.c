#include "worker/backend/devices.h"

#include "worker/backend/embree/embree.h"
#include "worker/backend/vulkan/gpu/gpu.h"

int kiln_backend_devices(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error)
{
    return gpu_list(list, room, count, error);
}

void kiln_backend_embree_version(char *text, size_t size) { embree_version(text, size); }
