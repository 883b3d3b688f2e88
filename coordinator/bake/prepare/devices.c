#include "coordinator/bake/prepare/devices.h"

#include <string.h>

#include "coordinator/files/kernel_cache.h"

void kiln_devices_choose(const struct kiln_job *job, int node_rank, int node_ranks, struct kiln_backend_params *params)
{
    params->device = (uint32_t)(job->machine.device + 1);
    params->local_rank = (uint32_t)node_rank;
    params->local_ranks = (uint32_t)node_ranks;
    params->traversal = job->faults.traversal;
    params->slice_seconds = job->faults.dispatch_time * 1e-3;
    params->device_memory = (uint64_t)(job->machine.device_memory * 0x1p30);
    /* a backend named with --backend must be used, or the bake fails; only `auto` falls back */
    params->goes_on = job->machine.backend == NULL || strcmp(job->machine.backend, "auto") == 0;
    params->verify_fraction = job->machine.verify_fraction;
    params->kernels = kiln_kernel_cache(job->machine.kernel_cache);
    params->faults = job->faults.device;
}
