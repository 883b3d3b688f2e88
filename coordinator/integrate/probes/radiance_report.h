/* The part of radiance probes in run.json (companion.h): the settings where gather rays end at a range, rays and
 * seconds of a step that gathers for them, and the probes. */
#ifndef KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_REPORT_H
#define KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_REPORT_H

#include "coordinator/integrate/companion.h"

void kiln_radiance_report_settings(const struct kiln_companion_told *told, json_t *json);
void kiln_radiance_report_step(const struct kiln_companion_told *told, json_t *json);
void kiln_radiance_report_light(const struct kiln_companion_told *told, json_t *json);

#endif
