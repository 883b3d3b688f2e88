/* Devices: the choice of a device by the options, and the list of `kiln info --devices`. Neither is collective. */
#ifndef KILN_COORDINATOR_CLI_DEVICES_H
#define KILN_COORDINATOR_CLI_DEVICES_H

#include "coordinator/job/job.h"
#include "worker/backend/backend.h"

/* Fills in the fields of `params` about devices, for rank `node_rank` of the `node_ranks` ranks of this node. */
void kiln_devices_choose(const struct kiln_job *job, int node_rank, int node_ranks, struct kiln_backend_params *params);

/* Prints Embree and every Vulkan device of this machine, and why kiln cannot use some of them. */
int kiln_devices_list(const struct kiln_job *job, struct kiln_error *error);

#endif
