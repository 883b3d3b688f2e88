/* The irradiance volume: its grid of probes, and the pass that gathers their light. */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_VOLUME_H
#define KILN_COORDINATOR_BAKE_VOLUME_VOLUME_H

#include "coordinator/run/checkpoint.h"
#include "coordinator/run/control.h"
#include "coordinator/field/result.h"
#include "coordinator/integrate/settings.h"
#include "coordinator/run/progress.h"

/* Collective. Writes a checkpoint of the light on the surfaces and of these arrays of probes. With `stop`, returns
 * KILN_STOPPED afterwards. */
typedef int (*kiln_volume_save)(void *context, const struct kiln_array_range *blocks, size_t count, bool stop,
                                struct kiln_error *error);

struct kiln_volume_params {
    MPI_Comm communicator;
    struct kiln_backend *backend; /* has its surface */
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    struct kiln_groups *groups; /* groups of the backend, whose light is kept apart; NULL: none */
    char *const *group_names;   /* borrowed */
    const uint64_t *radiosity;  /* of all points, packed (kiln_radiosity_pack) */
    double spacing;             /* m; 0: chosen automatically */
    const char *bounds;         /* of --volume-bounds; NULL: chosen automatically */
    uint32_t samples;           /* rays for each probe */
    /* settings of the surface light; they decide whether light paths bring a part of the light (probe_paths.h) */
    const struct kiln_integrate_settings *light;
    struct kiln_progress *progress;
    struct kiln_control *control;
    const struct kiln_checkpoint *checkpoint;
    bool restore; /* take the probes of the open generation; they have the same settings */
    kiln_volume_save save;
    void *context; /* of save */
};

/* Computes the grid. `spacing` divides the volume's bounds into boxes, with a probe in the middle of each, so that no
 * probe lies in a wall at the bounds. The bounds are `given`, a text of --volume-bounds, or with NULL the bounds of the
 * objects that receive light (volume_bounds.h). An axis that is shorter than the spacing gets one probe on either side.
 * A spacing of 0 stands for 1/16 of the longest side, adjusted on each axis. KILN_USAGE if there would be more than
 * 2^28 probes. Not collective, no side effects. */
int kiln_volume_grid(struct kiln_volume_result *volume, const struct kiln_scene *scene, double spacing,
                     const char *given, struct kiln_error *error);

/* Announces the passes of kiln_volume_run to the backend, which has its surface (kiln_backend_expect); `light` and
 * `samples` as in the parameters of that function. Not collective. KILN_SYSTEM. */
int kiln_volume_expect(const struct kiln_integrate_settings *light, struct kiln_backend *backend, uint32_t samples,
                       struct kiln_error *error);

/* Collective. Computes the grid and the light of this rank's range of probes; adds the number of rays to *rays.
 * KILN_STOPPED if something asked to stop. Destroy with kiln_volume_destroy. */
int kiln_volume_run(struct kiln_volume_result *volume, const struct kiln_volume_params *params, uint64_t *rays,
                    struct kiln_error *error);
void kiln_volume_destroy(struct kiln_volume_result *volume);

/* Collective. Writes a checkpoint with all probes of a complete volume. Returns KILN_STOPPED, or the error of writing.
 */
int kiln_volume_save_all(const struct kiln_volume_result *volume, const struct kiln_volume_params *params,
                         uint64_t *rays, struct kiln_error *error);

#endif
