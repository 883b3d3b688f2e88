#include "coordinator/integrate/land/land_plan.h"

#include <math.h>
#include <stdio.h>

#include "coordinator/integrate/land/land.h"
#include "coordinator/integrate/land/land_exchange.h"
#include "coordinator/integrate/land/merge.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/light/emission.h"
#include "worker/pass/weighed.h"

enum { SAMPLE_PATHS = 1 << 15, SAMPLE_BATCH = 1 << 12, SAMPLE_TILE_RUNS = 64, STRETCHES = 1 << 9 };
static const double LANDED_SECONDS = 0.1e-6;   /* of a rank, for a path that lands: sorted, sent and summed */
static const double MERGE_PASS_SECONDS = 2e-7; /* of one thread, for a point: the points near it found and summed */

/* ---- paths ---- */

/* Places where paths landed: how many beside points, and in which of STRETCHES equal parts of the points' curve. */
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

/* The backend that traces a pass: the host, where a device does not take it. */
static struct kiln_backend *tracer(const struct kiln_landing_sampling *t, const struct kiln_pass *pass,
                                   const void *parameters)
{
    return t->host == NULL || kiln_backend_takes(t->backend, pass, parameters) ? t->backend : t->host;
}

/* Seconds that the device, or the mean of the threads, was busy so far. */
static double busy_seconds(const struct kiln_landing_sampling *t, const struct kiln_backend *backend)
{
    struct kiln_backend_info info;
    kiln_backend_info(backend, &info);
    return info.device_seconds > 0.0 ? info.device_seconds : info.thread_seconds / t->threads;
}

int kiln_landing_sample(const struct kiln_landing_sampling *t, const struct kiln_land_parameters *parameters,
                        struct kiln_landing_sampled *found, struct kiln_error *error)
{
    const uint64_t paths = parameters->aims->paths, batches = paths < SAMPLE_PATHS
                                                                  ? (paths + SAMPLE_BATCH - 1) / SAMPLE_BATCH
                                                                  : SAMPLE_PATHS / SAMPLE_BATCH;
    struct kiln_backend *backend = tracer(t, &kiln_pass_land, parameters);
    const double begin = busy_seconds(t, backend);
    struct landings landings = {.points = t->points};
    uint64_t rays = 0, traced = 0;
    int status = KILN_OK;
    for (uint64_t i = 0; i < batches && status == KILN_OK; i++) {
        const uint64_t first = paths * i / batches, left = paths - first;
        const struct kiln_batch batch = {.first = first,
                                         .count = left < SAMPLE_BATCH ? left : SAMPLE_BATCH,
                                         .take = count_landed,
                                         .context = &landings};
        traced += batch.count;
        status = kiln_backend_run(backend, &kiln_pass_land, parameters, &batch, &rays, error);
    }
    found->path = (busy_seconds(t, backend) - begin) / (double)traced;
    found->landed = (double)landings.count / (double)traced;
    found->covered = covered_share(&landings);
    return status;
}

/* ---- the step ---- */

/* Figures of the step, which its memory hangs on, too. */
struct figures {
    uint64_t photons, aims;
    struct kiln_landing_sampled found;
    double gathered;   /* s of a point's rays, by all threads of a rank; 0: no rays share the light */
    double seconds;    /* of one rank that traces all paths of the step, and merges or gathers over all points */
    double bytes_sent; /* of each rank in an iteration, to others */
};

/* Rays of tile runs spread over the scene: seconds of a point by all threads. */
static int sample_rays(const struct kiln_companion_sample *sample, const struct kiln_landing_sampling *sampling,
                       const struct kiln_caustic_techniques *techniques, double *seconds, struct kiln_error *error)
{
    const struct kiln_surface *surface = sample->params->surface;
    const struct kiln_integrate_settings *settings = sample->params->settings;
    const size_t count = surface->tile_run_count, batches = count < SAMPLE_TILE_RUNS ? count : SAMPLE_TILE_RUNS;
    const uint32_t all = (settings->samples_indirect + settings->parts - 1) / settings->parts,
                   samples = kiln_landing_rays(settings, all, false);
    struct kiln_backend *backend = tracer(sampling, &kiln_pass_weighed, techniques);
    const double begin = busy_seconds(sampling, backend);
    uint64_t rays = 0, points = 0;
    int status = KILN_OK;
    for (size_t i = 0; i < batches && status == KILN_OK; i++) {
        const struct kiln_batch batch = {.first = count * i / batches, .count = 1, .samples = samples};
        points += surface->tile_runs[batch.first].count;
        status = kiln_backend_run(backend, &kiln_pass_weighed, techniques, &batch, &rays, error);
    }
    *seconds = points > 0 ? (busy_seconds(sampling, backend) - begin) / (double)points : 0.0;
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

static int measure_step(const struct kiln_companion_sample *sample, const struct kiln_landing_sampling *sampling,
                        const struct kiln_aims *aims, struct figures *f, struct kiln_error *error)
{
    const struct kiln_integrate_settings *settings = sample->params->settings;
    const bool shares = settings->caustics == KILN_CAUSTICS_VCM;
    struct kiln_emission *emission = NULL;
    int status = shares ? kiln_emission_create(&emission, sample->params->backend->params.lights, error) : KILN_OK;
    const struct kiln_caustic_techniques techniques = {
        .aims = aims, .emission = emission, .iterations = settings->iterations, .mis = settings->mis};
    const struct kiln_land_parameters parameters = {.aims = aims, .techniques = shares ? &techniques : NULL};
    if (status == KILN_OK)
        status = kiln_landing_sample(sampling, &parameters, &f->found, error);
    if (status == KILN_OK && shares)
        status = sample_rays(sample, sampling, &techniques, &f->gathered, error);
    kiln_emission_destroy(&emission);
    f->seconds = (double)f->photons * (settings->iterations + (shares ? 1.0 : 0.0)) *
                     (f->found.path + LANDED_SECONDS * f->found.landed) +
                 f->gathered * (double)sample->points;
    f->bytes_sent = (double)sizeof(struct kiln_landing_record) * f->found.landed * (double)f->photons *
                    (sample->ranks - 1.0) / sample->ranks / sample->ranks;
    return status;
}

static int measure_paths(const struct kiln_companion_sample *sample, struct figures *f, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = sample->params;
    struct kiln_landing_sampling sampling = {.backend = p->backend, .threads = p->threads, .points = sample->points};
    struct kiln_aims *aims = NULL;
    int status = kiln_aims_create(&aims, p->backend->params.lights, kiln_landing_aims(p->settings), error);
    KILN_TRY(status);
    if (aims->count > 0)
        KILN_TRY(kiln_landing_host(&sampling.host, p->backend, error));
    f->aims = aims->count;
    f->photons = kiln_landing_photons(p->settings, aims->count);
    if (f->photons >= aims->count && aims->count > 0) {
        kiln_aims_share(aims, f->photons, NULL);
        KILN_TRY(measure_step(sample, &sampling, aims, f, error));
    }
    f->seconds += merge_seconds(p->settings, sample->points, p->threads);
end:
    kiln_backend_destroy(&sampling.host);
    kiln_aims_destroy(&aims);
    return status;
}

/* ---- what is said of it ---- */

static json_t *figures_json(const struct figures *f, const struct kiln_companion_sample *sample)
{
    return json_pack("{s:I, s:i, s:I, s:f, s:f, s:f, s:f, s:f, s:f}", "photons", (json_int_t)f->photons, "iterations",
                     (int)sample->params->settings->iterations, "aims", (json_int_t)f->aims, "landed", f->found.landed,
                     "seconds_a_path", f->found.path, "seconds_of_one_rank", f->seconds, "bytes_sent_an_iteration",
                     f->bytes_sent, "seconds_a_point_gathered", f->gathered, "seconds_of_one_rank_for_probes",
                     sample->probe_seconds);
}

int kiln_landing_measure(const struct kiln_companion_sample *sample, struct kiln_companion_measured *measured,
                         struct kiln_error *error)
{
    static const char *const dark[] = {"caustic", "error_caustic", NULL};
    struct figures *f = NULL;
    int status;
    KILN_TRY(kiln_allocate(&f, 1, sizeof *f, "the plan of light paths", error));
    measured->own = f;
    KILN_TRY(measure_paths(sample, f, error));
    measured->seconds = f->seconds;
    if (f->photons > 0) {
        measured->dark = dark;
        measured->dark_share = 1.0 - f->found.covered;
        measured->json = figures_json(f, sample);
        (void)snprintf(measured->text, sizeof measured->text,
                       "%llu light paths in each of %u iterations; a rank sends %.1f MiB in each",
                       (unsigned long long)f->photons, sample->params->settings->iterations, f->bytes_sent / 1048576.0);
    }
end:
    return status;
}

void kiln_landing_demand(const struct kiln_companion_demand *d, struct kiln_companion_bytes *bytes)
{
    const struct figures *f = d->measured->own;
    if (f == NULL || f->photons == 0)
        return;
    bytes->in_step += kiln_landing_bytes(d->settings, (size_t)f->aims, d->own, d->ranks, f->found.landed) +
                      d->host_bvh + sizeof(uint32_t) * d->triangles; /* a target of each */
}
