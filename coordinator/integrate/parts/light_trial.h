/* Trial of the light of some tile runs, before a bake in rounds (rounds.h), from which its rounds are foretold
 * (rounds_foretold.h).
 *
 * Tile runs are chosen evenly over the global order. Each gets the direct light that it will get in the first round,
 * and as many paths as it will have gather rays there, in as many parts (parts.h). So the spread of the parts is the
 * error of raw light after that round, nearly: light of bounces has noise that neighbours share in the bake, and of
 * paths more noise, and its own. Light of caustics is left out, but for what paths find by chance. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_LIGHT_TRIAL_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_LIGHT_TRIAL_H

#include <mpi.h>

#include "coordinator/integrate/parts/rounds_foretold.h"
#include "worker/backend/backend.h"

/* All borrowed. */
struct kiln_light_trial_params {
    MPI_Comm communicator;
    const struct kiln_integrate_settings *settings; /* with a published_error */
    struct kiln_backend *backend;                   /* Embree, over the surface */
    const struct kiln_surface *surface;
};

/* Collective. Tries some tile runs of each rank: *tiles are those of all ranks, `count` of them, on rank 0, and none on
 * others. Free with kiln_free, after a failure too. KILN_SYSTEM, and what a backend fails with. */
int kiln_light_trial_run(const struct kiln_light_trial_params *params, struct kiln_tried_tile **tiles, size_t *count,
                         struct kiln_error *error);

#endif
