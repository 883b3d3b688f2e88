#include "coordinator/plan/landing.h"

#include <math.h>

#include "coordinator/bake/volume/probe_paths.h"
#include "coordinator/integrate/land/land.h"
#include "coordinator/integrate/land/land_exchange.h"
#include "coordinator/integrate/land/merge.h"
#include "worker/backend/extended.h"
#include "worker/light/aims.h"
#include "worker/light/emission.h"
#include "worker/pass/land.h"
#include "worker/pass/spheres.h"
#include "worker/pass/weighed.h"

enum { SAMPLE_PATHS = 1 << 15, SAMPLE_BATCH = 1 << 12, SAMPLE_TILE_RUNS = 64, STRETCHES = 1 << 9 };
static const double LANDED_SECONDS = 0.1e-6;   /* of a rank, for a path that lands: sorted, sent and summed */
static const double MERGE_PASS_SECONDS = 1e-6; /* of one thread, for a point: the points near it found and summed */

/* Where paths landed: how many beside points, and in which of STRETCHES equal parts of the points' curve. */
struct landings {
    uint64_t points, count;
    bool in[STRETCHES];
};

/* kiln_take_results */
static int count_landed(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)first, (void)error;
    struct landings *l = context;
    const struct kiln_land_result *r = results;
    for (size_t i = 0; i < count; i++)
        if (r[i].point != KILN_NO_POINT) {
            l->count++;
            l->in[(uint64_t)r[i].point * STRETCHES / l->points] = true;
        }
    return KILN_OK;
}

static double covered_share(const struct landings *l)
{
    const uint64_t all = l->points < STRETCHES ? l->points : STRETCHES;
    uint64_t in = 0;
    for (size_t i = 0; i < STRETCHES; i++)
        in += l->in[i];
    return all > 0 ? (double)in / (double)all : 0.0;
}

/* Setup of the measurement. */
struct measure {
    const struct kiln_prepared *p;
    const struct kiln_integrate_settings *settings;
    struct kiln_backend *host; /* for what a device leaves to Embree (kiln_landing_host); NULL: beside Embree */
    struct kiln_aims *aims;
    uint64_t points;
    uint32_t ranks;
};

static struct kiln_backend *tracer(const struct measure *m, const struct kiln_pass *pass, const void *parameters)
{
    return m->host == NULL || kiln_backend_takes(m->p->backend, pass, parameters) ? m->p->backend : m->host;
}

/* Seconds that the device, or all threads, were busy so far. */
static double busy_seconds(const struct measure *m, const struct kiln_backend *backend)
{
    struct kiln_backend_info info;
    kiln_backend_info(backend, &info);
    return info.device_seconds > 0.0 ? info.device_seconds : info.thread_seconds / m->p->threads;
}

/* Paths spread over all aims: where they land, *landed is their share beside points, and seconds of each by all
 * threads.
 */
static int sample_paths(const struct measure *m, const struct kiln_land_parameters *parameters,
                        struct landings *landings, double *landed, double *seconds, struct kiln_error *error)
{
    const uint64_t paths = m->aims->paths, batches = paths < SAMPLE_PATHS ? (paths + SAMPLE_BATCH - 1) / SAMPLE_BATCH
                                                                          : SAMPLE_PATHS / SAMPLE_BATCH;
    struct kiln_backend *backend = tracer(m, &kiln_pass_land, parameters);
    const double begin = busy_seconds(m, backend);
    uint64_t rays = 0, traced = 0;
    int status = KILN_OK;
    for (uint64_t i = 0; i < batches && status == KILN_OK; i++) {
        const uint64_t first = paths * i / batches, left = paths - first;
        const struct kiln_batch batch = {.first = first,
                                         .count = left < SAMPLE_BATCH ? left : SAMPLE_BATCH,
                                         .take = count_landed,
                                         .context = landings};
        traced += batch.count;
        status = kiln_backend_run(backend, &kiln_pass_land, parameters, &batch, &rays, error);
    }
    *seconds = (busy_seconds(m, backend) - begin) / (double)traced;
    *landed = (double)landings->count / (double)traced;
    return status;
}

/* Rays of tile runs spread over the scene: seconds of a point by all threads. */
static int sample_rays(const struct measure *m, const struct kiln_caustic_techniques *techniques, double *seconds,
                       struct kiln_error *error)
{
    const struct kiln_surface *surface = m->p->surface;
    const size_t count = surface->tile_run_count, batches = count < SAMPLE_TILE_RUNS ? count : SAMPLE_TILE_RUNS;
    const uint32_t all = (m->settings->samples_indirect + m->settings->parts - 1) / m->settings->parts,
                   samples = kiln_landing_rays(m->settings, all, false);
    struct kiln_backend *backend = tracer(m, &kiln_pass_weighed, techniques);
    const double begin = busy_seconds(m, backend);
    uint64_t rays = 0, points = 0;
    int status = KILN_OK;
    for (size_t i = 0; i < batches && status == KILN_OK; i++) {
        const struct kiln_batch batch = {.first = count * i / batches, .count = 1, .samples = samples};
        points += surface->tile_runs[batch.first].count;
        status = kiln_backend_run(backend, &kiln_pass_weighed, techniques, &batch, &rays, error);
    }
    *seconds = points > 0 ? (busy_seconds(m, backend) - begin) / (double)points : 0.0;
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

/* The step that lands; with --caustics vcm pilots are as many paths as an iteration has. */
static int measure_step(const struct measure *m, struct kiln_plan_landing *landing, struct kiln_error *error)
{
    const bool shares = m->settings->caustics == KILN_CAUSTICS_VCM;
    struct kiln_emission *emission = NULL;
    struct landings landings = {.points = m->points};
    int status = shares ? kiln_emission_create(&emission, m->p->lights, error) : KILN_OK;
    const struct kiln_caustic_techniques techniques = {
        .aims = m->aims, .emission = emission, .iterations = m->settings->iterations, .mis = m->settings->mis};
    const struct kiln_land_parameters parameters = {.aims = m->aims, .techniques = shares ? &techniques : NULL};
    if (status == KILN_OK)
        status = sample_paths(m, &parameters, &landings, &landing->landed, &landing->path, error);
    landing->covered = covered_share(&landings);
    if (status == KILN_OK && shares)
        status = sample_rays(m, &techniques, &landing->gathered, error);
    kiln_emission_destroy(&emission);
    landing->seconds = (double)landing->photons * (m->settings->iterations + (shares ? 1.0 : 0.0)) *
                           (landing->path + LANDED_SECONDS * landing->landed) +
                       landing->gathered * (double)m->points;
    landing->bytes_sent = (double)sizeof(struct kiln_landing_record) * landing->landed * (double)landing->photons *
                          (m->ranks - 1.0) / m->ranks / m->ranks;
    return status;
}

/* The paths for probes, whose spheres are taken in chunks. */
static int measure_probes(const struct measure *m, const struct kiln_volume_result *volume, uint32_t samples,
                          uint32_t leaves, struct kiln_plan_landing *landing, struct kiln_error *error)
{
    const uint64_t probes = volume->size[0] * volume->size[1] * volume->size[2];
    struct kiln_probe_spheres spheres = {.count = 0};
    struct landings landings = {.points = m->points};
    double landed, path = 0.0;
    if (probes == 0 || leaves == 0)
        return KILN_OK;
    int status = kiln_probe_spheres_try(&spheres, m->host != NULL ? m->host : m->p->backend, volume, m->p->scene,
                                        m->aims, leaves, error);
    const struct kiln_land_parameters parameters = {.aims = m->aims, .spheres = &spheres};
    if (status == KILN_OK)
        status = sample_paths(m, &parameters, &landings, &landed, &path, error);
    kiln_probe_spheres_release(&spheres);
    landing->probes = path * (double)kiln_probe_paths_photons(m->settings, m->aims->count, volume->size, samples) *
                      m->settings->iterations * m->settings->parts * ceil((double)probes / KILN_PROBE_PATHS_CHUNK);
    landing->probe_bytes = kiln_probe_paths_bytes(probes, m->ranks, m->host != NULL);
    return status;
}

int kiln_plan_landing_measure(struct kiln_plan_landing *landing, const struct kiln_prepared *p,
                              const struct kiln_integrate_settings *settings, const struct kiln_volume_result *volume,
                              uint32_t samples_probe, uint64_t points, uint32_t ranks, struct kiln_error *error)
{
    struct measure m = {.p = p, .settings = settings, .points = points, .ranks = ranks};
    uint32_t leaves = 0;
    *landing = (struct kiln_plan_landing){.photons = 0};
    if (settings->caustics < KILN_CAUSTICS_LAND)
        return KILN_OK;
    int status = kiln_aims_create(&m.aims, p->lights, kiln_landing_aims(settings), error);
    if (status == KILN_OK && m.aims->count > 0)
        status = kiln_landing_host(&m.host, p->backend, error);
    if (status == KILN_OK) {
        *landing = (struct kiln_plan_landing){.photons = kiln_landing_photons(settings, m.aims->count),
                                              .aims = m.aims->count,
                                              .iterations = settings->iterations};
        if (landing->photons >= m.aims->count && m.aims->count > 0) {
            kiln_aims_share(m.aims, landing->photons, NULL);
            status = measure_step(&m, landing, error);
            if (status == KILN_OK)
                status = kiln_probe_paths_leaves(settings, p->lights, samples_probe, &leaves, error);
            if (status == KILN_OK)
                status = measure_probes(&m, volume, samples_probe, leaves, landing, error);
        }
        landing->seconds += merge_seconds(settings, points, p->threads);
    }
    kiln_backend_destroy(&m.host);
    kiln_aims_destroy(&m.aims);
    return status;
}
