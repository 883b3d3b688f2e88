/* The list of devices of `kiln info --devices`. Not collective. */
#ifndef KILN_COORDINATOR_CLI_DEVICES_H
#define KILN_COORDINATOR_CLI_DEVICES_H

#include "coordinator/job/job.h"

/* Prints Embree and every Vulkan device of this machine, and why kiln cannot use some of them. */
int kiln_devices_list(const struct kiln_job *job, struct kiln_error *error);

#endif
