/* Where a bake runs: what the options say of devices, for the backend. Not collective. */
#ifndef KILN_COORDINATOR_BAKE_DEVICES_H
#define KILN_COORDINATOR_BAKE_DEVICES_H

#include "coordinator/job/job.h"
#include "worker/backend/backend.h"

/* Fills in the fields of `params` that are about devices, for the node_rank-th of node_ranks ranks on this node. */
void kiln_devices_choose(const struct kiln_job *job, int node_rank, int node_ranks, struct kiln_backend_params *params);

#endif
