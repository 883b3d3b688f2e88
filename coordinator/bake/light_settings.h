/* The settings of the integrators and of the lockstep runner, as a job has them. */
#ifndef KILN_COORDINATOR_BAKE_LIGHT_SETTINGS_H
#define KILN_COORDINATOR_BAKE_LIGHT_SETTINGS_H

#include "coordinator/integrate/settings.h"
#include "coordinator/job/job.h"

/* For a scene with so many surface points. */
struct kiln_integrate_settings kiln_light_settings(const struct kiln_job *job, uint64_t points);

#endif
