/* Light settings: turns a job into the settings of the integrators and of the lockstep runner. */
#ifndef KILN_COORDINATOR_BAKE_SETTINGS_LIGHT_SETTINGS_H
#define KILN_COORDINATOR_BAKE_SETTINGS_LIGHT_SETTINGS_H

#include "coordinator/integrate/settings.h"
#include "coordinator/job/job.h"
#include "worker/light/lights.h"

/* Number of light paths in an iteration: the job's number or, by default, as many as cost about half of the final
 * gather, within bounds. 0: no light paths are traced. */
uint32_t kiln_light_photons(const struct kiln_job *job, uint64_t points);

/* The settings of the job for a scene with these lights and `points` surface points. Not collective. */
struct kiln_integrate_settings kiln_light_settings(const struct kiln_job *job, const struct kiln_lights *lights,
                                                   uint64_t points);

#endif
