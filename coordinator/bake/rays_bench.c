#include "coordinator/bake/rays_bench.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "worker/backend/extended.h"
#include "worker/base/memory.h"
#include "worker/pass/gather.h"
#include "worker/scene/radiosity.h"

enum { RAYS_WANTED = 6000000, TILE_RUNS_AT_ONCE = 64 };
static const uint64_t DEVICE_RAYS_WANTED = 4000000000u; /* about a second on a GPU */

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

/* Returns the processor time of the thread, s. The bench has one thread, and other load on the machine does not
 * count. */
static double processor_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Runs the bench once on the CPU, with about RAYS_WANTED rays in groups of tile runs spread evenly over the rank's
 * points. Each group is traced first by the pass ([0]), then at once by Embree alone ([1]), so that other load affects
 * both alike. */
static int one_run(const struct kiln_prepared *p, uint32_t samples, double seconds[2], uint64_t rays[2],
                   struct kiln_error *error)
{
    const size_t count = p->surface->tile_run_count;
    const uint64_t points = RAYS_WANTED / samples + 1;
    const size_t runs_there = (count + TILE_RUNS_AT_ONCE - 1) / TILE_RUNS_AT_ONCE;
    size_t runs = (size_t)(points * runs_there / p->surface->count);
    runs = runs < 1 ? 1 : runs > runs_there ? runs_there : runs;
    int status = KILN_OK;
    for (size_t r = 0; r < runs && status == KILN_OK; r++) {
        const size_t first = r * runs_there / runs * TILE_RUNS_AT_ONCE;
        const struct kiln_batch batch = {.first = first,
                                         .count = count - first < TILE_RUNS_AT_ONCE ? count - first : TILE_RUNS_AT_ONCE,
                                         .stream = 1,
                                         .samples = samples};
        const double start = processor_seconds();
        status = kiln_backend_run(p->backend, &kiln_pass_gather, NULL, &batch, &rays[0], error);
        seconds[0] += processor_seconds() - start;
        if (status == KILN_OK)
            status = kiln_backend_ceiling(p->backend, &batch, &seconds[1], &rays[1], error);
    }
    return status;
}

/* Runs the bench once on a GPU. One batch has all tile runs, or as many as make DEVICE_RAYS_WANTED rays, so that the
 * GPU is busy. */
static int one_device_run(const struct kiln_prepared *p, uint32_t samples, double seconds[2], uint64_t rays[2],
                          struct kiln_error *error)
{
    struct kiln_batch batch = {.stream = 1, .samples = samples};
    uint64_t points = 0;
    while (batch.count < p->surface->tile_run_count && points * samples < DEVICE_RAYS_WANTED)
        points += p->surface->tile_runs[batch.count++].count;
    const double start = MPI_Wtime();
    const int status = kiln_backend_run(p->backend, &kiln_pass_gather, NULL, &batch, &rays[0], error);
    seconds[0] += MPI_Wtime() - start;
    return status == KILN_OK ? kiln_backend_ceiling(p->backend, &batch, &seconds[1], &rays[1], error) : status;
}

int kiln_rays_bench(const struct kiln_prepared *prepared, uint32_t samples, uint32_t repeats,
                    struct kiln_rays_bench *result, struct kiln_error *error)
{
    const struct kiln_surface *surface = prepared->surface;
    if (surface->count == 0)
        return kiln_fail(error, KILN_USAGE, "the scene has no surface points to trace rays from");
    kiln_backend_info(prepared->backend, &result->info);
    uint64_t *radiosity = NULL;
    double *figures = NULL;
    int status = kiln_allocate(&radiosity, surface->point_count, sizeof *radiosity, "radiosity", error);
    if (status == KILN_OK)
        status = kiln_allocate(&figures, 3 * (size_t)repeats, sizeof *figures, "figures", error);
    for (uint64_t i = 0; status == KILN_OK && i < surface->point_count; i++)
        radiosity[i] = kiln_radiosity_pack((const float[3]){1.0f, (float)(i % 7), (float)(i % 3)}, 0);
    if (status == KILN_OK)
        status = kiln_backend_set_radiosity(prepared->backend, radiosity, error);
    double *share = figures, *pass = figures + repeats, *ceiling = figures + 2 * repeats;
    for (uint32_t i = 0; i <= repeats && status == KILN_OK; i++) { /* the first run is a warm-up and does not count */
        double seconds[2] = {0};
        uint64_t rays[2] = {0};
        status = result->info.on_device ? one_device_run(prepared, samples, seconds, rays, error)
                                        : one_run(prepared, samples, seconds, rays, error);
        if (i == 0 || status != KILN_OK)
            continue;
        pass[i - 1] = (double)rays[0] / seconds[0];
        ceiling[i - 1] = (double)rays[1] / seconds[1];
        share[i - 1] = pass[i - 1] / ceiling[i - 1];
        result->rays = rays[0];
    }
    if (status == KILN_OK) {
        for (int k = 0; k < 3; k++)
            qsort(figures + (size_t)k * repeats, repeats, sizeof *figures, by_value);
        result->share = share[repeats / 2];
        result->share_low = share[0];
        result->share_high = share[repeats - 1];
        result->pass_rate = pass[repeats / 2];
        result->ceiling_rate = ceiling[repeats / 2];
    }
    kiln_free(&radiosity);
    kiln_free(&figures);
    return status;
}
