/* Adaptive sampling of direct light in the lean schedule. A pilot step gives every point a few samples; a second step
 * distributes the remaining samples over tiles by the variance of the pilot's results. It is not used in scenes with
 * many lights, where it does not pay, nor in a bake in parts (parts.h), whose samples are divided between the parts.
 * The results of the two steps are averaged with weights samples^1.5, because the variance of stratified samples at an
 * edge falls by this power (Mitchell, "Consequences of Stratified Sampling in Graphics", SIGGRAPH 1996).
 *
 * Let v be the variance of a point's result, E its irradiance, and e a fraction of the mean irradiance. The spread of a
 * tile is the mean of v / (E + e) over its points, or a fraction of a neighbour's spread if that is larger: a shadow
 * edge that the pilot has missed continues into the next tile. A point's samples are proportional to the square root of
 * the spread, which minimises the sum of v / (E + e) over all points for a given total (Lagrange's condition for v
 * proportional to 1 / samples). The unit is the tile and not the tile run, because cells cut tiles into runs and must
 * not change a result. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_ADAPT_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_ADAPT_H

#include "coordinator/integrate/integrator.h"

/* Samples of a point in the pilot; 0: there is none, and direct light is one step. */
uint32_t kiln_adapt_pilot(const struct kiln_integrate_settings *settings);

/* The weight of the second step's result in the average, for `pilot` samples in the pilot and `samples` in the step. */
double kiln_adapt_share(uint32_t pilot, uint32_t samples);

/* Collective, after the pilot, whose irradiance and errors are in the own points. Fills in the field of samples of the
 * own tile runs: `mean` a point on average over all tiles, or fewer if spreads ask for more than a tile may have. The
 * same for any ranks and cells, and never 0. KILN_SYSTEM. */
int kiln_adapt_samples(const struct kiln_integration *integration, uint32_t mean, struct kiln_error *error);

#endif
