/* The part of patches in run.json (companion.h): the settings of gathering from them, the visibility that they
 * kept, and their links. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_PATCHES_REPORT_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_PATCHES_REPORT_H

#include "coordinator/integrate/companion.h"

void kiln_patches_count(const struct kiln_solution *solution, uint64_t counts[KILN_COMPANION_COUNTS]);
void kiln_patches_report_settings(const struct kiln_companion_told *told, json_t *settings);
void kiln_patches_report_ranks(const struct kiln_companion_told *told, json_t *json);

#endif
