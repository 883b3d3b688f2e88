/* The part of light paths that land in run.json (companion.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_REPORT_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_REPORT_H

#include "coordinator/integrate/companion.h"

/* Adds what was traced, what a first round has found, and which passes the host has traced for a device. */
void kiln_landing_report_materials(const struct kiln_companion_told *told, json_t *json);
/* Adds the iterations of a step that lands. */
void kiln_landing_report_step(const struct kiln_companion_told *told, json_t *json);

#endif
