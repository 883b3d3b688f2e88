/* Probes inside geometry that have no light of their own get that of the nearest probes that have. Whoever interpolates
 * without looking at `validity`, as engines do, then finds no dark spots beside walls. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_PROBE_FILL_H
#define KILN_COORDINATOR_BAKE_VOLUME_PROBE_FILL_H

#include "coordinator/field/result.h"

/* Collective. Fills the buried probes (KILN_PROBE_BURIED) of a complete volume: their coefficients and their light
 * along the axes become the mean of those of the probes that are not, in the smallest box of the grid around the probe
 * that has any, of up to 17 x 17 x 17 probes, each weighted by 1 / distance². Their state becomes KILN_PROBE_FILLED;
 * validity, mean distance and occluders stay what they are. A pure function of the volume, so any number of ranks gives
 * the same bits. KILN_SYSTEM. */
int kiln_probe_fill(MPI_Comm communicator, struct kiln_volume_result *volume, struct kiln_error *error);

#endif
