/* What there is to compute on in this machine: for `kiln info --devices`, and to choose a backend. None of these is
 * collective. */
#ifndef KILN_WORKER_BACKEND_DEVICES_H
#define KILN_WORKER_BACKEND_DEVICES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* A Vulkan device of this machine. */
struct kiln_device {
    char name[128];   /* as the driver calls it */
    char driver[128]; /* name and version */
    uint8_t uuid[16];
    /* --device: real devices before software ones, each kind by UUID, the same in every process of a node */
    uint32_t index;
    uint32_t api_version; /* VK_MAKE_API_VERSION */
    bool software;        /* a CPU that plays a GPU */
    bool fit;             /* has what kiln needs; else `lacks` says what not */
    char lacks[160];
    bool ray_tracing; /* VK_KHR_ray_tracing_pipeline and what it needs */
    bool float64;
    uint32_t subgroup;
    uint64_t memory, budget; /* bytes: of the largest device-local heap; of it, free for this process */
};

/* Lists the Vulkan devices, at most `room`; writes how many there are to `count`. A machine without a loader or driver
 * has none: no error. */
int kiln_backend_devices(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error);

/* One line: Embree's version as it is installed. */
void kiln_backend_embree_version(char *text, size_t size);

#endif
