#include "coordinator/integrate/land/land_state.h"

#include <math.h>
#include <string.h>

#include "coordinator/run/control.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/base/color.h"
#include "worker/pass/land.h"

/* BATCH_PATHS paths are handed over at once; to a device OF_A_DEVICE times as many */
enum { BATCH_PATHS = 1 << 14, OF_A_DEVICE = 64 };
#define HANDED_SECONDS 0.25 /* work handed to a device at once, in s, if its speed is known */

int kiln_landing_host(struct kiln_backend **host, struct kiln_backend *bake, struct kiln_error *error)
{
    struct kiln_backend_params params = bake->params;
    struct kiln_backend_info info;
    *host = NULL;
    kiln_backend_info(bake, &info);
    if (!info.on_device)
        return KILN_OK;
    params.verify_fraction = 0.0;
    params.faults = (struct kiln_device_faults){0};
    const int status = kiln_backend_create(host, "embree", &params, error);
    return status == KILN_OK ? kiln_backend_set_surface(*host, bake->surface, error) : status;
}

/* Makes records of the paths that land, of a part of some paths, from number `next` on. */
static void keep_landed(struct kiln_landing *l, const struct kiln_land_result *results, size_t count, size_t next)
{
    const bool learns = !kiln_landing_shares(l);
    struct kiln_landing_moments moments = {0};
    for (const struct kiln_land_result *r = results; r < results + count; r++) {
        if (r->point == KILN_NO_POINT)
            continue;
        struct kiln_landing_record *record = kiln_land_exchange_put(&l->exchange, next++, r->point);
        memcpy(record->flux, r->flux, sizeof record->flux);
        record->shading = r->shading;
        record->taken_up = r->taken_up;
        record->others = r->others;
        record->aim = r->aim;
        if (learns)
            kiln_landing_note_moment(l, &moments, r->aim, kiln_luminance_of_floats(r->flux));
    }
    kiln_landing_note_rest(l, &moments);
}

static size_t count_landed(const struct kiln_land_result *results, size_t count)
{
    size_t landed = 0;
    for (size_t i = 0; i < count; i++)
        landed += results[i].point != KILN_NO_POINT;
    return landed;
}

/* Implements kiln_take_results: each thread handles a range of consecutive paths. */
static int take(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)first;
    struct kiln_landing *l = context;
    const struct kiln_land_result *r = results;
    const size_t parts = count > BATCH_PATHS / 2 ? l->params->threads : 1;
    size_t all = 0;
#pragma omp parallel for num_threads((int)parts) schedule(static, 1)
    for (size_t part = 0; part < parts; part++)
        l->landed[part] = count_landed(r + count * part / parts, count * (part + 1) / parts - count * part / parts);
    for (size_t part = 0; part < parts; part++) {
        const size_t next = l->exchange.count + all;
        all += l->landed[part];
        l->landed[part] = next;
    }
    const int status = kiln_land_exchange_grow(&l->exchange, all, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)parts) schedule(static, 1)
    for (size_t part = 0; part < parts; part++)
        keep_landed(l, r + count * part / parts, count * (part + 1) / parts - count * part / parts, l->landed[part]);
    l->exchange.count += all;
    return KILN_OK;
}

int kiln_landing_run_pass(struct kiln_landing *l, const struct kiln_pass *pass, const void *parameters,
                          const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct kiln_backend *bake = l->params->backend;
    if (kiln_backend_takes(bake, pass, parameters))
        return kiln_backend_run(bake, pass, parameters, batch, rays, error);
    const int status = l->own == NULL ? kiln_landing_host(&l->own, bake, error) : KILN_OK;
    l->solution->report.landing.on_host |= 1u << pass->index;
    return status == KILN_OK ? kiln_backend_run(l->own, pass, parameters, batch, rays, error) : status;
}

static int trace(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_land_parameters parameters = {.aims = l->aims,
                                                    .techniques = kiln_landing_shares(l) ? &l->techniques : NULL};
    const struct kiln_batch batch = {.first = first, .count = count, .take = take, .context = l};
    return kiln_landing_run_pass(l, &kiln_pass_land, &parameters, &batch, rays, error);
}

/* Collective. Saves a checkpoint without the block under way, which will be traced anew. */
static int save(struct kiln_landing *l, bool stop, struct kiln_error *error)
{
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    const uint64_t rays = report->rays;
    report->rays = l->rays_before;
    const int status = stop ? kiln_save_and_stop(l->saved, false, error) : kiln_save(l->saved, false, error);
    report->rays = rays;
    return status;
}

static double device_seconds(const struct kiln_backend *backend)
{
    struct kiln_backend_info info;
    kiln_backend_info(backend, &info);
    return info.device_seconds;
}

int kiln_landing_work_through(struct kiln_landing *l, uint64_t begin, uint64_t end, uint64_t at_once,
                              kiln_landing_work work, int status, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    uint64_t next = begin;
    l->rays_before = report->rays;
    for (;;) {
        enum kiln_event event;
        if (status == KILN_OK && next < end) {
            const double start = MPI_Wtime(), busy = device_seconds(p->backend);
            const uint64_t now = end - next < at_once ? end - next : at_once;
            status = work(l, next, now, &report->rays, error);
            next += now;
            const double seconds = MPI_Wtime() - start;
            report->seconds += seconds;
            report->device_seconds += fmax(0.0, device_seconds(p->backend) - busy);
            event = kiln_control_poll(p->control, next == end, (double)(next - begin) / (double)(end - begin), seconds,
                                      status);
        } else {
            event = kiln_control_wait(p->control, true, 1.0, status, NULL, NULL);
        }
        if (event == KILN_EVENT_FAIL || event == KILN_EVENT_DONE)
            return kiln_agree(p->communicator, status, error);
        if (event == KILN_EVENT_STOP)
            return save(l, true, error);
        if (event == KILN_EVENT_SAVE) {
            const int saved = save(l, false, error);
            if (saved != KILN_OK)
                return saved;
        }
    }
}

uint64_t kiln_landing_at_once(const struct kiln_landing *l, uint64_t of_the_host)
{
    struct kiln_backend_info info;
    kiln_backend_info(l->params->backend, &info);
    return info.on_device ? OF_A_DEVICE * of_the_host : of_the_host;
}

/* Returns the number of paths to hand over at once. A device gets less than a block, so that it traces while the host
 * processes the paths before. */
static uint64_t paths_at_once(const struct kiln_landing *l)
{
    const uint64_t least = kiln_landing_at_once(l, BATCH_PATHS);
    const double some = fmin(HANDED_SECONDS * l->speed, (double)KILN_LAND_BATCH);
    return least > BATCH_PATHS && some > (double)least ? (uint64_t)some : least;
}

/* Collective. Traces this rank's part of the batch of paths [first, first + count). */
static int trace_batch(struct kiln_landing *l, uint64_t first, uint64_t count, struct kiln_error *error)
{
    const uint64_t rank = (uint64_t)l->params->rank, ranks = (uint64_t)l->params->ranks,
                   begin = first + count * rank / ranks, end = first + count * (rank + 1) / ranks;
    const double *seconds = &kiln_solution_step(l->solution)->seconds, before = *seconds;
    l->exchange.count = 0;
    memcpy(l->moments_before, l->moments, l->aims->count * sizeof *l->moments);
    const int status = kiln_landing_work_through(l, begin, end, paths_at_once(l), trace, KILN_OK, error);
    l->speed = *seconds > before ? (double)(end - begin) / (*seconds - before) : 0.0;
    return status;
}

int kiln_landing_run_paths(struct kiln_landing *l, uint64_t number, uint64_t before, kiln_take_landings take_landings,
                           struct kiln_error *error)
{
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    const uint64_t paths = l->aims->paths;
    int status = KILN_OK;
    while (l->done < paths && status == KILN_OK) {
        const uint64_t count = paths - l->done < KILN_LAND_BATCH ? paths - l->done : KILN_LAND_BATCH;
        status = trace_batch(l, number * paths + l->done, count, error);
        const double start = MPI_Wtime();
        kiln_control_blocking(l->params->control, "exchanging landings of light", 0.0);
        if (status == KILN_OK)
            status = kiln_land_exchange(&l->exchange, take_landings, l, error);
        kiln_control_blocking(l->params->control, NULL, 0.0);
        report->exchange_seconds += MPI_Wtime() - start;
        l->done += count;
        kiln_progress_advance(l->params->progress, before + l->done);
    }
    return status;
}
