#include "coordinator/bake/volume/probe_paths.h"

#include <math.h>

#include "coordinator/integrate/land/land.h"
#include "coordinator/integrate/land/land_plan.h"
#include "worker/light/aims.h"
#include "worker/pass/land.h"
#include "worker/pass/spheres.h"

/* Paths through the spheres of a chunk; `aims` have their shares. */
static int measure(const struct kiln_probe_paths_params *p, const struct kiln_volume_result *grid,
                   const struct kiln_landing_sampling *sampling, const struct kiln_aims *aims, uint32_t leaves,
                   struct kiln_probe_paths_cost *cost, uint32_t ranks, struct kiln_error *error)
{
    const uint64_t probes = grid->size[0] * grid->size[1] * grid->size[2];
    struct kiln_probe_spheres spheres = {.count = 0};
    struct kiln_landing_sampled found = {.path = 0.0};
    if (probes == 0 || leaves == 0)
        return KILN_OK;
    int status = kiln_probe_spheres_try(&spheres, sampling->host != NULL ? sampling->host : sampling->backend, grid,
                                        p->scene, aims, leaves, error);
    const struct kiln_land_parameters parameters = {.aims = aims, .spheres = &spheres};
    if (status == KILN_OK)
        status = kiln_landing_sample(sampling, &parameters, &found, error);
    kiln_probe_spheres_release(&spheres);
    cost->seconds = found.path * (double)kiln_probe_paths_photons(p->settings, aims->count, grid->size, p->samples) *
                    p->settings->iterations * p->settings->parts * ceil((double)probes / KILN_PROBE_PATHS_CHUNK);
    cost->bytes = kiln_probe_paths_bytes(probes, ranks, sampling->host != NULL);
    return status;
}

int kiln_probe_paths_measure(struct kiln_probe_paths_cost *cost, const struct kiln_probe_paths_params *p,
                             const struct kiln_volume_result *grid, uint64_t points, uint32_t threads, uint32_t ranks,
                             struct kiln_error *error)
{
    const struct kiln_lights *lights = p->backend->params.lights;
    struct kiln_landing_sampling sampling = {.backend = p->backend, .threads = threads, .points = points};
    struct kiln_aims *aims = NULL;
    uint32_t leaves = 0;
    *cost = (struct kiln_probe_paths_cost){.seconds = 0.0};
    if (p->settings->caustics < KILN_CAUSTICS_LAND)
        return KILN_OK;
    int status = kiln_aims_create(&aims, lights, kiln_landing_aims(p->settings), error);
    KILN_TRY(status);
    const uint64_t photons = kiln_landing_photons(p->settings, aims->count);
    if (aims->count == 0 || photons < aims->count)
        goto end;
    kiln_aims_share(aims, photons, NULL);
    KILN_TRY(kiln_landing_host(&sampling.host, p->backend, error));
    KILN_TRY(kiln_probe_paths_leaves(p->settings, lights, p->samples, &leaves, error));
    KILN_TRY(measure(p, grid, &sampling, aims, leaves, cost, ranks, error));
end:
    kiln_backend_destroy(&sampling.host);
    kiln_aims_destroy(&aims);
    return status;
}
