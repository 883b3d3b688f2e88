/* Choice of devices: turns the options about devices into parameters of the backend. Not collective. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_DEVICES_H
#define KILN_COORDINATOR_BAKE_PREPARE_DEVICES_H

#include "coordinator/job/job.h"
#include "worker/backend/backend.h"

/* Fills in the fields of `params` about devices, for rank `node_rank` of the `node_ranks` ranks of this node. */
void kiln_devices_choose(const struct kiln_job *job, int node_rank, int node_ranks, struct kiln_backend_params *params);

#endif
