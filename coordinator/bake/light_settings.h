/* Light settings: turns a job into the settings of the integrators and of the lockstep runner. */
#ifndef KILN_COORDINATOR_BAKE_LIGHT_SETTINGS_H
#define KILN_COORDINATOR_BAKE_LIGHT_SETTINGS_H

#include "coordinator/integrate/settings.h"
#include "coordinator/job/job.h"
#include "worker/light/lights.h"

/* The settings of the job for a scene with these lights and `points` surface points. Not collective. */
struct kiln_integrate_settings kiln_light_settings(const struct kiln_job *job, const struct kiln_lights *lights,
                                                   uint64_t points);

#endif
