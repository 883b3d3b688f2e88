/* Fill of buried probes: probes inside geometry, without light of their own, get the light of the nearest probes that
 * have light. Engines interpolate without looking at `validity`; the fill avoids dark spots beside walls there. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_PROBE_FILL_H
#define KILN_COORDINATOR_BAKE_VOLUME_PROBE_FILL_H

#include "coordinator/field/result.h"

/* Collective. Fills the buried probes (KILN_PROBE_BURIED) of a complete volume. Their coefficients and their light
 * along the axes become a mean over unburied probes, each weighted by 1 / distance². These are the unburied probes in
 * the smallest box of the grid around the probe that has any, of up to 17 x 17 x 17 probes. The state becomes
 * KILN_PROBE_FILLED; validity, mean distance and occluders stay unchanged. A pure function of the volume, so any number
 * of ranks gives the same bits. KILN_SYSTEM. */
int kiln_probe_fill(MPI_Comm communicator, struct kiln_volume_result *volume, struct kiln_error *error);

#endif
