/* The irradiance volume of a mixture of groups of lights (mix_factors.h). */
#ifndef KILN_COORDINATOR_CLI_MIX_VOLUME_H
#define KILN_COORDINATOR_CLI_MIX_VOLUME_H

#include <mpi.h>

#include "coordinator/cli/mix_maps.h"

/* Whether the bake, whose run.json this is, has a volume that can be mixed. */
bool kiln_mix_has_volume(const struct kiln_results *results, const json_t *run);

/* Collective. Writes volume.hdf of the mixture: coefficients and light along the axes are mixed as lightmaps are; what
 * hangs on no light is as in the bake. `has` is the same on all ranks; without it nothing is done. The status is the
 * same on all ranks. */
int kiln_mix_volume(const struct kiln_mix_params *params, const json_t *run, bool has, MPI_Comm communicator,
                    struct kiln_error *error);

#endif
