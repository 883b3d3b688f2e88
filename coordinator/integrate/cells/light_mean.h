/* Mean light of all points, which decisions by tiles (coordinator/integrate/tile_sums.h) are relative to. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_LIGHT_MEAN_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_LIGHT_MEAN_H

#include "coordinator/integrate/integrator.h"

/* Collective. Computes the mean luminance over all valid points of `values`, 3 an own point, W/m2; with `areas`, one an
 * own point, the mean power, W. The same for any ranks. */
int kiln_light_mean(const struct kiln_integration *integration, const float *values, const float *areas, double *mean,
                    struct kiln_error *error);

#endif
