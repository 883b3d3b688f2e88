#include "coordinator/integrate/land.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/land_exchange.h"
#include "coordinator/integrate/step_work.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/light/emission.h"
#include "worker/pass/land.h"
#include "worker/pass/point.h"
#include "worker/pass/weighed.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"

#define LEARNT 0.9          /* part of the paths that goes by what was learnt */
#define EVEN 0.25           /* of shares that are learnt once for all: part that all aims have alike */
#define MOMENT_STEP 65536.0 /* second moments are sums of whole numbers of 1 / this */
#define MOMENT_MOST 0x1p38  /* of one path: 2^24 of the rarest kind fit in 64 bits */

enum { BATCH_PATHS = 1 << 14, GIVEN_TILE_RUNS = 256, PATHS_AN_AIM = 4, PILOTS = 4 };

#define PILOT_ITERATION ((uint64_t)1 << 31) /* paths of pilots are numbered from this iteration on */

struct kiln_landing {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    const struct kiln_saved *saved;
    struct kiln_aims *aims;
    uint64_t photons;         /* of an iteration */
    struct kiln_backend *own; /* of the step, where the bake's backend is a device: light paths are the host's */
    /* --caustics vcm, else NULL; what light paths share their light with, and how much (the areas are of the step) */
    struct kiln_emission *emission;
    struct kiln_caustic_techniques techniques;
    struct kiln_landing_weights landing_weights;
    float *areas;
    /* of an iteration: this rank's second moments by aim; of all so far: by aim, and the paths that they are of */
    uint64_t *moments;
    double *learnt, *paths, *weights;
    bool counted; /* rays of the light paths of the step are counted already */
    /* of a block */
    struct kiln_landing_record *records;
    size_t count;
    uint64_t first_path;
    /* of the step */
    struct kiln_land_exchange exchange;
    struct kiln_landing_sum *sums; /* of own points */
    struct kiln_point_result *results;
};

static int make_room(struct kiln_landing *l, struct kiln_error *error)
{
    const size_t aims = l->aims->count;
    const char *what = "the moments of light paths";
    int status = kiln_allocate(&l->moments, aims, sizeof *l->moments, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->learnt, aims, sizeof *l->learnt, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->paths, aims, sizeof *l->paths, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->weights, aims, sizeof *l->weights, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->results, GIVEN_TILE_RUNS * KILN_TILE_TEXELS, sizeof *l->results,
                               "the answers of tile runs", error);
    return status;
}

int kiln_landing_create(struct kiln_landing **landing, const struct kiln_integrate_params *params,
                        struct kiln_solution *solution, const struct kiln_saved *saved, struct kiln_error *error)
{
    uint64_t photons = params->settings->photons;
    struct kiln_landing *l = NULL;
    int status = kiln_allocate(&l, 1, sizeof *l, "the landings of light", error);
    *landing = l;
    if (status != KILN_OK)
        return status;
    *l = (struct kiln_landing){.params = params, .solution = solution, .saved = saved};
    status = kiln_aims_create(&l->aims, params->backend->params.lights, error);
    if (status == KILN_OK && !params->settings->photons_given && photons < PATHS_AN_AIM * l->aims->count)
        photons = PATHS_AN_AIM * l->aims->count;
    l->photons = photons;
    if (status == KILN_OK && photons < l->aims->count)
        status =
            kiln_fail(error, KILN_USAGE,
                      "--photons %llu is less than the %zu pairs of a lamp and an object with gloss, each of which "
                      "needs a path: give --photons %zu or more",
                      (unsigned long long)photons, l->aims->count, l->aims->count);
    if (status == KILN_OK)
        status = make_room(l, error);
    if (status == KILN_OK && params->settings->caustics == KILN_CAUSTICS_VCM)
        status = kiln_emission_create(&l->emission, params->backend->params.lights, error);
    l->techniques = (struct kiln_caustic_techniques){.aims = l->aims,
                                                     .emission = l->emission,
                                                     .iterations = params->settings->iterations,
                                                     .mis = params->settings->mis};
    if (status != KILN_OK)
        kiln_landing_destroy(landing);
    return status;
}

static void end_step(struct kiln_landing *l)
{
    kiln_backend_destroy(&l->own);
    kiln_land_exchange_release(&l->exchange);
    kiln_free(&l->records);
    kiln_free(&l->sums);
    kiln_free(&l->areas);
}

void kiln_landing_destroy(struct kiln_landing **landing)
{
    struct kiln_landing *l = *landing;
    if (l == NULL)
        return;
    end_step(l);
    kiln_aims_destroy(&l->aims);
    kiln_emission_destroy(&l->emission);
    kiln_free(&l->moments);
    kiln_free(&l->learnt);
    kiln_free(&l->paths);
    kiln_free(&l->weights);
    kiln_free(&l->results);
    kiln_free(landing);
}

/* ---- paths ---- */

static void note_moment(struct kiln_landing *l, uint32_t aim, double luminance)
{
    const struct kiln_aims *a = l->aims;
    const double paths = (double)(a->first[aim + 1] - a->first[aim]), flux = luminance * paths / a->aims[aim].flux;
    if (a->aims[aim].flux > 0.0)
        l->moments[aim] += (uint64_t)fmin(MOMENT_STEP * flux * flux, MOMENT_MOST);
}

/* kiln_take_results */
static int take(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct kiln_landing *l = context;
    const struct kiln_land_result *r = results;
    for (size_t i = 0; i < count; i++, r++) {
        if (r->point == KILN_NO_POINT)
            continue;
        struct kiln_landing_record *record = &l->records[l->count++];
        *record = (struct kiln_landing_record){.point = r->point,
                                               .path = (uint32_t)(first + i - l->first_path),
                                               .shading = r->shading,
                                               .taken_up = r->taken_up,
                                               .others = r->others,
                                               .aim = r->aim};
        memcpy(record->flux, r->flux, sizeof record->flux);
        if (l->emission == NULL)
            note_moment(l, r->aim, kiln_luminance_of_floats(r->flux));
    }
    return KILN_OK;
}

static struct kiln_backend *backend_of(const struct kiln_landing *l)
{
    return l->own != NULL ? l->own : l->params->backend;
}

static int trace(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_land_parameters parameters = {.aims = l->aims,
                                                    .techniques = l->emission != NULL ? &l->techniques : NULL};
    const struct kiln_batch batch = {.first = first, .count = count, .take = take, .context = l};
    return kiln_backend_run(backend_of(l), &kiln_pass_land, &parameters, &batch, rays, error);
}

/* Collective. Traces this rank's part of the block of paths [first, first + count), and waits for the others; saves and
 * stops when that is asked for. */
static int trace_block(struct kiln_landing *l, uint64_t first, uint64_t count, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    const uint64_t rank = (uint64_t)p->rank, ranks = (uint64_t)p->ranks, begin = first + count * rank / ranks,
                   end = first + count * (rank + 1) / ranks;
    uint64_t next = begin, ignored = 0;
    int status = KILN_OK;
    l->count = 0;
    l->first_path = first;
    for (;;) {
        enum kiln_event event;
        if (status == KILN_OK && next < end) {
            const double start = MPI_Wtime();
            const uint64_t now = end - next < BATCH_PATHS ? end - next : BATCH_PATHS;
            status = trace(l, next, now, l->counted ? &ignored : &report->rays, error);
            next += now;
            const double seconds = MPI_Wtime() - start;
            report->seconds += seconds;
            event = kiln_control_poll(p->control, next == end, (double)(next - begin) / (double)(end - begin), seconds,
                                      status);
        } else {
            event = kiln_control_wait(p->control, true, 1.0, status, NULL, NULL);
        }
        if (event == KILN_EVENT_FAIL || event == KILN_EVENT_DONE)
            return kiln_agree(p->communicator, status, error);
        if (event == KILN_EVENT_STOP)
            return kiln_save_and_stop(l->saved, false, error);
        if (event == KILN_EVENT_SAVE) {
            const int saved = kiln_save(l->saved, false, error);
            if (saved != KILN_OK)
                return saved;
        }
    }
}

/* ---- aims ---- */

/* Collective. Adds an iteration's moments to those learnt, and shares `paths` of the next one out by them. */
static void correct_aims(struct kiln_landing *l, uint64_t paths)
{
    struct kiln_aims *a = l->aims;
    double sent = 0.0, sum = 0.0;
    (void)MPI_Allreduce(MPI_IN_PLACE, l->moments, (int)a->count, MPI_UINT64_T, MPI_SUM, l->params->communicator);
    for (size_t i = 0; i < a->count; i++) {
        l->learnt[i] += (double)l->moments[i] / MOMENT_STEP;
        l->paths[i] += (double)(a->first[i + 1] - a->first[i]);
        l->weights[i] = a->aims[i].flux * sqrt(l->learnt[i] / l->paths[i]);
        sent += a->aims[i].flux;
        sum += l->weights[i];
        l->moments[i] = 0;
    }
    const double even = l->emission != NULL ? EVEN / (1.0 - EVEN) / (double)a->count : 0.0;
    for (size_t i = 0; i < a->count; i++)
        l->weights[i] = (sum > 0.0 ? LEARNT * l->weights[i] / sum : 0.0) +
                        (sent > 0.0 ? (1.0 - LEARNT) * a->aims[i].flux / sent : 0.0) + even;
    kiln_aims_share(a, paths, l->weights);
}

static void forget(struct kiln_landing *l)
{
    const size_t count = l->aims->count;
    memset(l->moments, 0, count * sizeof *l->moments);
    memset(l->learnt, 0, count * sizeof *l->learnt);
    memset(l->paths, 0, count * sizeof *l->paths);
    kiln_aims_share(l->aims, l->photons, NULL);
}

/* ---- a step ---- */

/* Collective. Whether the bake goes on from a checkpoint within the step after its light paths, whose rays are counted
 * among those of tile runs then; paths that are traced again before are counted again. */
static bool goes_on_after_paths(const struct kiln_landing *l)
{
    int any = l->emission != NULL && kiln_step_work_points(l->saved->work, l->solution->own) > 0;
    (void)MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_MAX, l->params->communicator);
    return any != 0;
}

/* A device leaves light paths to the host's processors (worker/pass/land.h), which need a BVH of their own for them. */
static int open_backend(struct kiln_landing *l, struct kiln_error *error)
{
    struct kiln_backend *bake = l->params->backend;
    struct kiln_backend_params params = bake->params;
    struct kiln_backend_info info;
    kiln_backend_info(bake, &info);
    if (strcmp(info.name, "embree") == 0)
        return KILN_OK;
    params.verify_fraction = 0.0;
    params.faults = (struct kiln_device_faults){0};
    const int status = kiln_backend_create(&l->own, "embree", &params, error);
    return status == KILN_OK ? kiln_backend_set_surface(l->own, bake->surface, error) : status;
}

static float presence(const struct kiln_landing *l, const struct kiln_surface *surface,
                      const struct kiln_point_cursor *at);

/* By what the landings on own points are weighed. */
static int find_weights(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_surface *own = &l->solution->own->surface;
    const int status = kiln_allocate(&l->areas, own->count, sizeof *l->areas, "the areas of points", error);
    for (size_t f = 0; status == KILN_OK && f < own->tile_run_count; f++) {
        struct kiln_point_cursor at = kiln_point_first(own, f);
        for (uint32_t k = 0; k < own->tile_runs[f].count; k++, kiln_point_next(own, &at))
            if (kiln_point_valid(own, at.point))
                l->areas[at.point.at] = (float)kiln_lit_area(own, at.point, presence(l, own, &at));
    }
    l->landing_weights = (struct kiln_landing_weights){
        .mis = l->techniques.mis, .rays = (double)kiln_solution_step(l->solution)->step.samples, .area = l->areas};
    return status;
}

/* Collective. */
static int begin_step(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_surface *own = &l->solution->own->surface;
    const uint64_t block = l->aims->paths < KILN_LAND_BLOCK ? l->aims->paths : KILN_LAND_BLOCK,
                   ranks = (uint64_t)l->params->ranks;
    int status = kiln_allocate(&l->sums, own->count, sizeof *l->sums, "the light that lands on points", error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->records, (block + ranks - 1) / ranks, sizeof *l->records,
                               "the landings of light paths", error);
    if (status == KILN_OK && l->aims->count > 0)
        status = open_backend(l, error);
    if (status == KILN_OK && l->emission != NULL)
        status = find_weights(l, error);
    status = kiln_agree(l->params->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_land_exchange_create(&l->exchange, l->params->communicator, own->first.at, own->count, error);
    l->exchange.weights = l->emission != NULL ? &l->landing_weights : NULL;
    return status;
}

/* kiln_take_landing: its light counts. */
static void add_landing(void *context, const struct kiln_landing_record *record, double weight)
{
    struct kiln_landing *l = context;
    kiln_land_add(record, weight, &l->sums[record->point - l->exchange.first[l->exchange.rank]]);
}

/* kiln_take_landing: of a pilot, whose light does not count. */
static void learn_from_landing(void *context, const struct kiln_landing_record *record, double weight)
{
    note_moment(context, record->aim, weight * kiln_luminance_of_floats(record->flux));
}

/* Collective. */
static int run_iteration(struct kiln_landing *l, uint64_t iteration, uint64_t before, kiln_take_landing take_landing,
                         struct kiln_error *error)
{
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    const uint64_t paths = l->aims->paths;
    int status = KILN_OK;
    for (uint64_t first = 0; first < paths && status == KILN_OK; first += KILN_LAND_BLOCK) {
        const uint64_t count = paths - first < KILN_LAND_BLOCK ? paths - first : KILN_LAND_BLOCK;
        status = trace_block(l, iteration * paths + first, count, error);
        const double start = MPI_Wtime();
        kiln_control_blocking(l->params->control, "exchanging landings of light", 0.0);
        if (status == KILN_OK)
            status = kiln_land_exchange(&l->exchange, l->records, l->count, take_landing, l, error);
        kiln_control_blocking(l->params->control, NULL, 0.0);
        report->exchange_seconds += MPI_Wtime() - start;
        kiln_progress_advance(l->params->progress, before + first + count);
    }
    return status;
}

/* Collective. Paths that teach how those of all iterations are shared out, in a few rounds of which each learns from
 * those before, and bring no light. Their number, as many as an iteration's at least, goes to *count. */
static int run_pilots(struct kiln_landing *l, uint64_t part, uint64_t *count, struct kiln_error *error)
{
    const uint64_t paths = l->photons / PILOTS > l->aims->count ? l->photons / PILOTS : l->aims->count;
    int status = KILN_OK;
    kiln_aims_share(l->aims, paths, NULL);
    for (uint64_t i = 0; i < PILOTS && status == KILN_OK; i++) {
        status = run_iteration(l, PILOT_ITERATION + part * PILOTS + i, i * paths, learn_from_landing, error);
        if (status == KILN_OK)
            correct_aims(l, i + 1 < PILOTS ? paths : l->photons);
    }
    *count = PILOTS * paths;
    return status;
}

int kiln_landing_run(struct kiln_landing *l, struct kiln_error *error)
{
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    const uint64_t iterations = l->params->settings->iterations, part = report->step.part; /* has paths of its own */
    l->counted = goes_on_after_paths(l);
    report->rays = l->counted ? report->rays : 0;
    forget(l);
    end_step(l);
    uint64_t before = 0;
    int status = begin_step(l, error);
    kiln_progress_phase(l->params->progress, "light paths", iterations * l->aims->paths);
    kiln_control_begin(l->params->control, "light paths");
    if (status == KILN_OK && l->emission != NULL && l->aims->count > 0)
        status = run_pilots(l, part, &before, error);
    for (uint64_t i = 0; i < iterations && status == KILN_OK && l->aims->count > 0; i++) {
        status = run_iteration(l, part * iterations + i, before + i * l->aims->paths, add_landing, error);
        if (status == KILN_OK && i + 1 < iterations && l->emission == NULL)
            correct_aims(l, l->aims->paths);
    }
    return status;
}

/* ---- answers ---- */

/* What there is of the point's surface, as the passes that gather have it: kiln_point_result.present. */
static float presence(const struct kiln_landing *l, const struct kiln_surface *surface,
                      const struct kiln_point_cursor *at)
{
    const struct kiln_backend_params *b = &l->params->backend->params;
    const uint64_t texel = (uint64_t)at->y * surface->lightmaps[at->map].width + at->x;
    struct kiln_footprint footprint;
    struct kiln_mask mask;
    if (b->geometry->opaque_count == b->geometry->triangle_count)
        return 1.0f;
    kiln_footprint_prepare(&footprint, b->scene, b->geometry, surface, at);
    return kiln_footprint_opacity(&footprint, kiln_texel_key(KILN_LOOKS_KEY, at->map, texel), &mask);
}

static struct kiln_point_result answer(const struct kiln_landing *l, const struct kiln_surface *surface,
                                       const struct kiln_point_cursor *at)
{
    const struct kiln_landing_sum *sum = &l->sums[at->point.at];
    struct kiln_point_result r = {.present = 1.0f, .count = 1};
    if (!kiln_point_valid(surface, at->point))
        return (struct kiln_point_result){.count = 0};
    r.present = presence(l, surface, at);
    const double area = kiln_lit_area(surface, at->point, r.present),
                 scale = area > 0.0 ? 1.0 / (area * (double)l->params->settings->iterations) : 0.0;
    for (int c = 0; c < 3; c++) {
        r.irradiance[c] = (float)(sum->irradiance[c] * scale);
        r.incident[c] = (float)(sum->incident[c] * scale);
    }
    r.error = (float)(sqrt(sum->square) * scale);
    return r;
}

/* What was gathered at a point, and what has landed. */
static void combine(const struct kiln_point_result *landed, struct kiln_point_result *r)
{
    const float n = (float)r->count;
    for (int c = 0; c < 3; c++) {
        r->irradiance[c] += n * landed->irradiance[c];
        r->incident[c] += n * landed->incident[c];
    }
    r->error = hypotf(r->error, n * landed->error);
}

/* A batch of which gather rays find a part. */
struct gathered {
    struct kiln_landing *landing;
    const struct kiln_batch *batch;
};

/* kiln_take_results */
static int take_gathered(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    const struct gathered *g = context;
    struct kiln_landing *l = g->landing;
    const struct kiln_surface *surface = &l->solution->own->surface;
    const struct kiln_point_result *next = results;
    int status = KILN_OK;
    for (size_t end = first + count, stop; first < end && status == KILN_OK; first = stop) {
        size_t points = 0;
        stop = end - first < GIVEN_TILE_RUNS ? end : first + GIVEN_TILE_RUNS;
        for (size_t f = first; f < stop; f++) {
            struct kiln_point_cursor at = kiln_point_first(surface, f);
            for (uint32_t k = 0; k < surface->tile_runs[f].count; k++, kiln_point_next(surface, &at)) {
                const struct kiln_point_result landed = answer(l, surface, &at);
                l->results[points] = *next++;
                combine(&landed, &l->results[points++]);
            }
        }
        status = g->batch->take(g->batch->context, first, stop - first, l->results, error);
    }
    return status;
}

/* Gather rays of the batch, which find what light paths leave to them. */
static int give_gathered(struct kiln_landing *l, const struct kiln_batch *batch, struct kiln_error *error)
{
    struct gathered g = {l, batch};
    struct kiln_batch rays = *batch;
    rays.take = take_gathered;
    rays.context = &g;
    return kiln_backend_run(backend_of(l), &kiln_pass_weighed, &l->techniques, &rays,
                            &kiln_solution_step(l->solution)->rays, error);
}

int kiln_landing_give(struct kiln_landing *l, const struct kiln_batch *batch, struct kiln_error *error)
{
    const struct kiln_surface *surface = &l->solution->own->surface;
    if (l->emission != NULL && l->aims->count > 0)
        return give_gathered(l, batch, error);
    int status = KILN_OK;
    for (size_t first = batch->first, end = batch->first + batch->count, next; first < end && status == KILN_OK;
         first = next) {
        size_t count = 0;
        next = end - first < GIVEN_TILE_RUNS ? end : first + GIVEN_TILE_RUNS;
        for (size_t f = first; f < next; f++) {
            struct kiln_point_cursor at = kiln_point_first(surface, f);
            for (uint32_t k = 0; k < surface->tile_runs[f].count; k++, kiln_point_next(surface, &at))
                l->results[count++] = answer(l, surface, &at);
        }
        status = batch->take(batch->context, first, next - first, l->results, error);
    }
    return status;
}
