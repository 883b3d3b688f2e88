/* Adaptive samples of direct light in the lean schedule: a pilot gives every point a few samples, and a second step the
 * rest, tile by tile by how much the pilot's answers spread; not where the scene has many lights, for there that does
 * not pay, and not in a bake in parts (parts.h), whose samples are shared out between the parts. Both are combined by
 * their numbers of samples to the power of 1.5: the variance of stratified samples of an edge falls so (Mitchell,
 * "Consequences of Stratified Sampling in Graphics", SIGGRAPH 1996).
 *
 * With a variance v of a point's answer and its irradiance E, and e a part of the mean irradiance, a tile's spread is
 * the mean of v / (E + e) over its points, or a share of a neighbour's where that is more: an edge of a shadow that the
 * pilot's samples have missed goes on beyond a tile. A point's samples go by the square root of the spread, which makes
 * the sum of v / (E + e) over all points least for the samples of all (Lagrange's condition for v that goes by the
 * inverse of the samples). Tiles and not tile runs, because cells cut tiles into runs and must not change a result. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_ADAPT_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_ADAPT_H

#include "coordinator/integrate/integrator.h"

/* Samples of a point in the pilot; 0: there is none, and direct light is one step. */
uint32_t kiln_adapt_pilot(const struct kiln_integrate_settings *settings);

/* The share of the second step's answer in what both say, when the pilot had `pilot` samples and the step `samples`. */
double kiln_adapt_share(uint32_t pilot, uint32_t samples);

/* Collective, after the pilot, whose irradiance and errors the own points have. Fills in the field of samples of the
 * own tile runs: `mean` a point, over all tiles, or fewer where spreads ask for more than a tile may have. The same for
 * any ranks and cells, and never 0. KILN_SYSTEM. */
int kiln_adapt_samples(const struct kiln_integration *integration, uint32_t mean, struct kiln_error *error);

#endif
