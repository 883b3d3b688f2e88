#include "coordinator/plan/landing.h"

#include <math.h>

#include "coordinator/integrate/land.h"
#include "coordinator/integrate/land_exchange.h"
#include "coordinator/integrate/merge.h"
#include "worker/light/aims.h"
#include "worker/pass/land.h"

enum { SAMPLE_PATHS = 1 << 15, SAMPLE_BATCH = 1 << 12 };
static const double LANDED_SECONDS = 0.2e-6;   /* of a rank, for a path that lands: sorted, sent and summed */
static const double MERGE_PASS_SECONDS = 1e-6; /* of one thread, for a point: the points near it found and summed */

/* kiln_take_results */
static int count_landed(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)first, (void)error;
    uint64_t *landed = context;
    const struct kiln_land_result *r = results;
    for (size_t i = 0; i < count; i++)
        *landed += r[i].point != KILN_NO_POINT;
    return KILN_OK;
}

/* Paths spread over all aims; seconds by all threads. */
static int sample_paths(struct kiln_backend *backend, const struct kiln_aims *aims, uint32_t threads,
                        struct kiln_plan_landing *landing, struct kiln_error *error)
{
    const struct kiln_land_parameters parameters = {.aims = aims};
    const uint64_t batches =
        aims->paths < SAMPLE_PATHS ? (aims->paths + SAMPLE_BATCH - 1) / SAMPLE_BATCH : SAMPLE_PATHS / SAMPLE_BATCH;
    struct kiln_backend_info begin, end;
    uint64_t rays = 0, landed = 0, traced = 0;
    int status = KILN_OK;
    kiln_backend_info(backend, &begin);
    for (uint64_t i = 0; i < batches && status == KILN_OK; i++) {
        const uint64_t first = aims->paths * i / batches, left = aims->paths - first;
        const struct kiln_batch batch = {.first = first,
                                         .count = left < SAMPLE_BATCH ? left : SAMPLE_BATCH,
                                         .take = count_landed,
                                         .context = &landed};
        traced += batch.count;
        status = kiln_backend_run(backend, &kiln_pass_land, &parameters, &batch, &rays, error);
    }
    kiln_backend_info(backend, &end);
    landing->path = (end.thread_seconds - begin.thread_seconds) / threads / (double)traced;
    landing->landed = (double)landed / (double)traced;
    return status;
}

static double merge_seconds(const struct kiln_integrate_settings *settings, uint64_t points, uint32_t threads)
{
    const double radii = floor(log2((double)settings->iterations)) + 1.0,
                 found = settings->merge_radius == KILN_MERGE_RADIUS_AUTO ? KILN_MERGE_SEARCH_PASSES : 0.0;
    const double passes = settings->caustics == KILN_CAUSTICS_MERGE ? KILN_MERGE_PASSES * radii + found
                          : kiln_landing_spreads(settings)          ? KILN_MERGE_PASSES + KILN_MERGE_FIT_PASSES
                                                                    : 0.0;
    return MERGE_PASS_SECONDS * passes * (double)points / threads;
}

int kiln_plan_landing_measure(struct kiln_plan_landing *landing, const struct kiln_prepared *p,
                              const struct kiln_integrate_settings *settings, uint64_t points, uint32_t ranks,
                              struct kiln_error *error)
{
    struct kiln_aims *aims = NULL;
    struct kiln_backend *host = NULL;
    *landing = (struct kiln_plan_landing){.photons = 0};
    if (settings->caustics < KILN_CAUSTICS_LAND)
        return KILN_OK;
    int status = kiln_aims_create(&aims, p->lights, error);
    if (status == KILN_OK && aims->count > 0)
        status = kiln_landing_host(&host, p->backend, error);
    if (status == KILN_OK) {
        *landing = (struct kiln_plan_landing){.photons = kiln_landing_photons(settings, aims->count),
                                              .aims = aims->count,
                                              .iterations = settings->iterations};
        const bool enough = landing->photons >= aims->count && aims->count > 0;
        if (enough) {
            kiln_aims_share(aims, landing->photons, NULL);
            status = sample_paths(host != NULL ? host : p->backend, aims, p->threads, landing, error);
        }
        const double paths = enough ? (double)landing->photons * settings->iterations : 0.0;
        landing->seconds =
            paths * (landing->path + LANDED_SECONDS * landing->landed) + merge_seconds(settings, points, p->threads);
        landing->bytes_sent = (double)sizeof(struct kiln_landing_record) * landing->landed * (double)landing->photons *
                              (ranks - 1.0) / ranks / ranks;
    }
    kiln_backend_destroy(&host);
    kiln_aims_destroy(&aims);
    return status;
}
