/* Where a bake runs: what the options say of devices, and `kiln info --devices`. Neither is collective. */
#ifndef KILN_COORDINATOR_CLI_DEVICES_H
#define KILN_COORDINATOR_CLI_DEVICES_H

#include "coordinator/job/job.h"
#include "worker/backend/backend.h"

/* Fills in the fields of `params` that are about devices, for the node_rank-th of node_ranks ranks on this node. */
void kiln_devices_choose(const struct kiln_job *job, int node_rank, int node_ranks, struct kiln_backend_params *params);

/* Prints Embree and every Vulkan device of this machine, with what is amiss with those that kiln cannot use. */
int kiln_devices_list(const struct kiln_job *job, struct kiln_error *error);

#endif
