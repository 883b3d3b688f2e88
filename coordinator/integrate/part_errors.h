/* The standard errors of a bake in parts (parts.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_PART_ERRORS_H
#define KILN_COORDINATOR_INTEGRATE_PART_ERRORS_H

#include "coordinator/field/rank_data.h"

enum { KILN_PART_ERRORS = 64 }; /* of a tile run at most */

/* The standard errors of the luminance of a tile run's points, one after the other. */
void kiln_part_errors(const struct kiln_rank_data *data, const struct kiln_tile_run *run,
                      float errors[KILN_PART_ERRORS]);

#endif
