/* The irradiance volume of a mixture of groups of lights (mix_factors.h). */
#ifndef KILN_COORDINATOR_CLI_MIX_VOLUME_H
#define KILN_COORDINATOR_CLI_MIX_VOLUME_H

#include <mpi.h>

#include "coordinator/cli/mix_maps.h"

/* Whether a bake with this run.json has a volume that can be mixed. */
bool kiln_mix_has_volume(const struct kiln_results *results, const json_t *run);

/* Collective. Writes volume.hdf of the mixture: coefficients and light along the axes are mixed as lightmaps are; data
 * that do not depend on light are copied from the bake. `has` is the same on all ranks; if it is false nothing is done.
 * The status is the same on all ranks. */
int kiln_mix_volume(const struct kiln_mix_params *params, const json_t *run, bool has, MPI_Comm communicator,
                    struct kiln_error *error);

#endif
