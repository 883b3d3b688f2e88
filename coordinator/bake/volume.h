/* The irradiance volume's grid and its probes. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_H
#define KILN_COORDINATOR_BAKE_VOLUME_H

#include "coordinator/run/checkpoint.h"
#include "coordinator/run/control.h"
#include "coordinator/field/result.h"
#include "coordinator/run/progress.h"

/* Collective. Writes a checkpoint of all before the probes and these blocks of them; with `stop` returns KILN_STOPPED
 * then. */
typedef int (*kiln_volume_save)(void *context, const struct kiln_block *blocks, size_t count, bool stop,
                                struct kiln_error *error);

struct kiln_volume_params {
    MPI_Comm communicator;
    struct kiln_backend *backend; /* has its surface */
    const struct kiln_scene *scene;
    const uint64_t *radiosity; /* all points */
    double spacing;            /* m; 0: chosen */
    uint32_t samples;
    struct kiln_progress *progress;
    struct kiln_control *control;
    const struct kiln_checkpoint *checkpoint;
    bool restore; /* probes in its open generation are of these settings, and not gathered again */
    kiln_volume_save save;
    void *context; /* of save */
};

/* The grid alone: probes stand in the middle of the boxes that `spacing` cuts the scene's bounds into, so that none
 * lies in a wall that is part of the bounds; an axis thinner than the spacing gets one on either side. A chosen spacing
 * is 1/16 of the longest side, adjusted on each axis. KILN_USAGE when there would be more than 2^28 probes. Pure. */
int kiln_volume_grid(struct kiln_volume_result *volume, const struct kiln_scene *scene, double spacing,
                     struct kiln_error *error);

/* Collective. KILN_STOPPED when something asked to stop. Fills the grid and this rank's range of probes; `rays` is
 * added to. Destroy with kiln_volume_destroy. */
int kiln_volume_run(struct kiln_volume_result *volume, const struct kiln_volume_params *params, uint64_t *rays,
                    struct kiln_error *error);
void kiln_volume_destroy(struct kiln_volume_result *volume);

/* Collective. Writes a checkpoint with all probes of a volume that is complete, and returns KILN_STOPPED, or why it
 * cannot. */
int kiln_volume_save_all(const struct kiln_volume_result *volume, const struct kiln_volume_params *params,
                         uint64_t *rays, struct kiln_error *error);

#endif
