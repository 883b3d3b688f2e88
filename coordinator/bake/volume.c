#include "coordinator/bake/volume.h"

#include <math.h>

#include "coordinator/cli/agree.h"
#include "worker/base/memory.h"

enum { PROBES_ALONG = 16, BATCH_LEAST = 256, BATCH_MOST = 1 << 16, BATCH_RAYS = 1 << 24 };

int kiln_volume_grid(struct kiln_volume_result *volume, const struct kiln_scene *scene, double spacing, struct kiln_error *error)
{
    const double *low = scene->header->bounds_min, *high = scene->header->bounds_max;
    *volume = (struct kiln_volume_result){0};
    double longest = 0.0;
    for (int a = 0; a < 3; a++)
        longest = fmax(longest, high[a] - low[a]);
    const bool chosen = spacing <= 0.0;
    if (chosen)
        spacing = longest > 0.0 ? longest / PROBES_ALONG : 1.0;
    double total = 1.0;
    for (int a = 0; a < 3; a++) {
        const double extent = high[a] - low[a];
        double count = extent < spacing ? 2.0 : floor(extent / spacing + 0.5);
        count = fmax(count, 1.0);
        volume->spacing[a] = chosen && extent >= spacing ? extent / count : spacing;
        volume->origin[a] = 0.5 * (low[a] + high[a]) - 0.5 * (count - 1.0) * volume->spacing[a];
        total *= count;
        if (total > 0x1p28)
            return kiln_fail(error, KILN_USAGE, "a probe every %g m would make more than %.0f probes in a scene of %g x %g x %g m; "
                             "use a larger --probe-spacing", spacing, 0x1p28, high[0] - low[0], high[1] - low[1], high[2] - low[2]);
        volume->size[a] = (uint64_t)count;
    }
    return KILN_OK;
}

/* Relative to the scene's centre, in the order of the index. */
static struct kiln_vec3 position_of(const struct kiln_volume_result *v, const double centre[3], uint64_t index)
{
    const uint64_t at[3] = {index % v->size[0], index / v->size[0] % v->size[1], index / (v->size[0] * v->size[1])};
    double p[3];
    for (int a = 0; a < 3; a++)
        p[a] = v->origin[a] + (double)at[a] * v->spacing[a] - centre[a];
    return vec3((float)p[0], (float)p[1], (float)p[2]);
}

/* Probes a call: enough to fill a GPU, few enough for the progress to be seen. */
static uint64_t batch_size(uint32_t samples)
{
    const uint64_t count = BATCH_RAYS / (uint64_t)samples;
    return count < BATCH_LEAST ? BATCH_LEAST : count > BATCH_MOST ? BATCH_MOST : count;
}

int kiln_volume_run(struct kiln_volume_result *volume, const struct kiln_volume_params *params, uint64_t *rays, struct kiln_error *error)
{
    int rank, ranks;
    (void)MPI_Comm_rank(params->communicator, &rank);
    (void)MPI_Comm_size(params->communicator, &ranks);
    int status = kiln_volume_grid(volume, params->scene, params->spacing, error);
    if (status != KILN_OK)
        return status; /* the same on all ranks */
    const uint64_t total = volume->size[0] * volume->size[1] * volume->size[2];
    volume->first = total * (uint64_t)rank / (uint64_t)ranks;
    volume->count = total * ((uint64_t)rank + 1) / (uint64_t)ranks - volume->first;
    struct kiln_probe_result *probes = NULL;
    struct kiln_vec3 *positions = NULL;
    const uint64_t batch = batch_size(params->samples);
    status = kiln_allocate(&probes, volume->count, sizeof *probes, "the probes", error);
    if (status == KILN_OK)
        status = kiln_allocate(&positions, batch, sizeof *positions, "probe positions", error);
    if (status == KILN_OK)
        status = kiln_backend_set_radiosity(params->backend, params->radiosity, error);
    kiln_progress_phase(params->progress, "probes", volume->count);
    for (uint64_t done = 0; done < volume->count && status == KILN_OK;) {
        const uint64_t count = volume->count - done < batch ? volume->count - done : batch;
        for (uint64_t i = 0; i < count; i++)
            positions[i] = position_of(volume, params->scene->header->centre, volume->first + done + i);
        status = kiln_backend_probes(params->backend, positions, count, volume->first + done, params->samples, probes + done, rays, error);
        done += count;
        kiln_progress_advance(params->progress, done);
    }
    kiln_free(&positions);
    volume->probes = probes;
    return kiln_agree(params->communicator, status, error);
}

void kiln_volume_destroy(struct kiln_volume_result *volume)
{
    struct kiln_probe_result *probes = (struct kiln_probe_result *)(uintptr_t)volume->probes;
    kiln_free(&probes);
    volume->probes = NULL;
}
