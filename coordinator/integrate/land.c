#include "coordinator/integrate/land.h"

#include <math.h>
#include <string.h>

#include "coordinator/field/field_blocks.h"
#include "coordinator/integrate/land_exchange.h"
#include "coordinator/integrate/land_factors.h"
#include "coordinator/integrate/merge.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/mirror_images.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/light/emission.h"
#include "worker/pass/caustic.h"
#include "worker/pass/land.h"
#include "worker/pass/point.h"
#include "worker/pass/weighed.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"

#define EVEN 0.25           /* of shares that are learnt once for all: part that all aims have alike */
#define MOMENT_STEP 65536.0 /* second moments are sums of whole numbers of 1 / this */
#define MOMENT_MOST 0x1p38  /* of one path: 2^24 of the rarest kind fit in 64 bits */

enum { BATCH_PATHS = 1 << 14, GIVEN_TILE_RUNS = 256, PATHS_AN_AIM = 4, PILOTS = 4 };
enum { AIMS_MOST = 1024, PATHS_OF_CUTS = 64 }; /* objects are cut up to so many aims, each of so many paths */
/* rays of a point from which factors of techniques are learnt: at least, and a part of those of the step */
enum { PILOT_RAYS = 16, PILOT_PART = 16, PILOT_STREAM = 0x8000, PILOT_TILE_RUNS = 64, RAY_TILE_RUNS = 16 };
enum { OF_A_DEVICE = 64 }; /* so many times as much is handed to a device at once */

#define LARGEST 6.0   /* texels: the radius within which landings that share are spread, at most */
#define LANDINGS 16.0 /* in one iteration: on which a point's light is to hang */
/* Paths that gather rays connect with, for a quarter of the samples: one for so many points, within these, and one an
 * aim at least. They are numbered from this iteration on, four a part. */
enum { KEPT_LEAST = 1 << 8, KEPT_MOST = 1 << 12, POINTS_A_KEPT_PATH = 4, KEPT_QUARTERS = 4 };
#define KEPT_ITERATION ((uint64_t)3 << 30)
#define PILOT_ITERATION ((uint64_t)1 << 31)    /* paths of pilots are numbered from this iteration on */
#define EXCHANGE_ITERATION ((uint64_t)1 << 33) /* and those for exchanges */

/* The block "landing" of a checkpoint, once: where the step stands. After it "landing_learnt" and "landing_paths",
 * once, an element an aim; "landing_moments", likewise, of each rank; "landing_sums" and, where they are merged,
 * "landing_merged", an element a point; and "landing_factors", once, an element a region. */
struct saved_landing {
    uint64_t step; /* its number */
    uint64_t iteration, done, photons, aims;
    double radius;
};
_Static_assert(sizeof(struct saved_landing) == 48, "a record has no gaps");

struct kiln_landing {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    const struct kiln_saved *saved;
    struct kiln_aims *aims, *kept; /* kept: of light paths that gather rays connect with; NULL: they do not */
    uint64_t photons;              /* of an iteration */
    struct kiln_backend
        *own; /* of the step: Embree, where the bake's backend is a device that leaves it some of this */
    /* --caustics vcm, else NULL; what light paths share their light with, and how much */
    struct kiln_emission *emission;
    struct kiln_mirror_images *images; /* or NULL, where no flat mirror shows a lamp without extent */
    struct kiln_caustic_techniques techniques;
    struct kiln_landing_weights landing_weights;
    struct kiln_land_factors factors;             /* where the weights have some */
    struct kiln_caustic_moments *moments_of_rays; /* of own points, of pilots */
    /* of an iteration: this rank's second moments by aim; of all so far: by aim, and the paths that they are of */
    uint64_t *moments;
    double *learnt, *paths, *weights;
    uint64_t iteration, done; /* iterations that are done; paths of the next one */
    /* as they were when the block under way began: of all of it that a checkpoint has */
    uint64_t *moments_before, rays_before;
    struct saved_landing record;
    bool begun;    /* a step has: the checkpoint has nothing of those after it, and its files may be gone by then */
    bool restored; /* what was learnt and landed before, from a checkpoint */
    bool pilots;   /* the paths under way bring no light; a checkpoint has nothing of them */
    /* of a block */
    struct kiln_landing_record *records;
    size_t count;
    uint64_t first_path;
    /* of the step */
    struct kiln_land_exchange exchange;
    struct kiln_landing_sum *sums; /* of own points; where they are merged, of iterations of the radius under way */
    struct kiln_point_result *results;
    float *lit; /* m2, an own point: area that is there to be lit; with --caustics merge and vcm, else NULL */
    /* where what lands is spread over points nearby (--caustics merge, vcm); else NULL */
    struct kiln_merged *merged;
    struct kiln_merge *merge;          /* from when it is first spread on */
    struct kiln_landing_sum *gathered; /* of --caustics vcm, or NULL: what rays find, as if it had landed */
    double radius;                     /* m, at first; of --caustics vcm the largest */
};

/* Whether gather rays find a part of the light. */
static bool shares(const struct kiln_landing *l) { return l->emission != NULL; }
/* And has them, which needs light paths. */
static bool gathers(const struct kiln_landing *l) { return shares(l) && l->aims->count > 0; }

/* Whether pilots teach factors of the techniques. */
static bool has_factors(const struct kiln_landing *l) { return gathers(l) && kiln_mis_learns(l->techniques.mis); }
/* Whether these are of exchanges between the techniques. */
static bool exchanges(const struct kiln_landing *l) { return l->techniques.mis == KILN_MIS_OPTIMAL; }

/* Of the step. */
static uint64_t iterations_of(const struct kiln_landing *l) { return kiln_solution_step(l->solution)->step.iterations; }

static bool merges(const struct kiln_landing *l) { return l->params->settings->caustics == KILN_CAUSTICS_MERGE; }

bool kiln_landing_spreads(const struct kiln_integrate_settings *settings)
{
    return settings->caustics == KILN_CAUSTICS_VCM && settings->merge_radius != KILN_MERGE_RADIUS_TEXEL;
}

static bool spreads(const struct kiln_landing *l) { return kiln_landing_spreads(l->params->settings); }

/* Whether what gather rays find is spread with what lands. */
static bool spreads_rays(const struct kiln_landing *l) { return gathers(l) && spreads(l); }

uint64_t kiln_landing_photons(const struct kiln_integrate_settings *settings, size_t aims)
{
    const uint64_t photons = settings->photons, least = PATHS_AN_AIM * (uint64_t)aims;
    return settings->photons_given || photons > least ? photons : least;
}

size_t kiln_landing_aims(const struct kiln_integrate_settings *settings)
{
    const uint64_t most = settings->photons / PATHS_OF_CUTS;
    return most < AIMS_MOST ? (size_t)most : AIMS_MOST;
}

int kiln_landing_host(struct kiln_backend **host, struct kiln_backend *bake, struct kiln_error *error)
{
    struct kiln_backend_params params = bake->params;
    struct kiln_backend_info info;
    *host = NULL;
    kiln_backend_info(bake, &info);
    if (strcmp(info.name, "embree") == 0)
        return KILN_OK;
    params.verify_fraction = 0.0;
    params.faults = (struct kiln_device_faults){0};
    const int status = kiln_backend_create(host, "embree", &params, error);
    return status == KILN_OK ? kiln_backend_set_surface(*host, bake->surface, error) : status;
}

/* Of a quarter of the samples. */
static uint64_t kept_paths(size_t aims, double points)
{
    const double paths = fmin(fmax(points / POINTS_A_KEPT_PATH, KEPT_LEAST), KEPT_MOST);
    return paths > (double)aims ? (uint64_t)paths : (uint64_t)aims;
}

uint64_t kiln_landing_bytes(const struct kiln_integrate_settings *settings, size_t aims, double points, uint32_t ranks,
                            double landed)
{
    const double photons = (double)kiln_landing_photons(settings, aims),
                 block = fmin(photons, (double)KILN_LAND_BLOCK) / ranks,
                 records = (double)sizeof(struct kiln_landing_record) * block * (ranks > 1 ? 1.0 + landed : 1.0),
                 aim = (double)sizeof(struct kiln_aim) + 6.0 * sizeof(double);
    double point = (double)kiln_landing_saved_bytes(settings->caustics);
    if (settings->caustics == KILN_CAUSTICS_MERGE)
        point += (double)KILN_MERGE_POINT_BYTES;
    if (kiln_landing_spreads(settings)) /* and a radius */
        point += (double)(sizeof(struct kiln_merged) + sizeof(struct kiln_landing_sum) + KILN_MERGE_POINT_BYTES +
                          sizeof(float));
    if (settings->caustics >= KILN_CAUSTICS_MERGE) /* and what is there to be lit */
        point += (double)sizeof(float);
    if (settings->caustics == KILN_CAUSTICS_VCM && kiln_mis_learns(settings->mis))
        point += (double)(sizeof(struct kiln_caustic_moments) + sizeof(uint32_t));
    const double kept = settings->caustics == KILN_CAUSTICS_VCM && settings->connections > 0.0
                            ? aim * (double)aims + (double)KILN_KEPT_PATH_BYTES *
                                                       (double)(KEPT_QUARTERS * kept_paths(aims, points * ranks))
                            : 0.0;
    return (uint64_t)(records + kept + aim * (double)aims + point * points);
}

uint64_t kiln_landing_saved_bytes(enum kiln_caustics caustics)
{
    return caustics < KILN_CAUSTICS_LAND
               ? 0
               : sizeof(struct kiln_landing_sum) + (caustics == KILN_CAUSTICS_MERGE ? sizeof(struct kiln_merged) : 0);
}

static int make_room(struct kiln_landing *l, struct kiln_error *error)
{
    const size_t aims = l->aims->count;
    const char *what = "the moments of light paths";
    int status = kiln_allocate(&l->moments, aims, sizeof *l->moments, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&l->moments_before, aims, sizeof *l->moments_before, what, error);
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
    struct kiln_landing *l = NULL;
    int status = kiln_allocate(&l, 1, sizeof *l, "the landings of light", error);
    *landing = l;
    if (status != KILN_OK)
        return status;
    *l = (struct kiln_landing){.params = params, .solution = solution, .saved = saved};
    status = kiln_aims_create(&l->aims, params->backend->params.lights, kiln_landing_aims(params->settings), error);
    const uint64_t photons = status == KILN_OK ? kiln_landing_photons(params->settings, l->aims->count) : 0;
    l->photons = photons;
    if (status == KILN_OK)
        solution->report.landing = (struct kiln_landing_report){.photons = photons, .aims = l->aims->count};
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
    if (status == KILN_OK && shares(l))
        status = kiln_mirror_images_create(&l->images, params->backend->params.lights, error);
    if (status == KILN_OK && shares(l) && params->settings->connections > 0.0)
        status = kiln_aims_create(&l->kept, params->backend->params.lights, kiln_landing_aims(params->settings), error);
    l->techniques = (struct kiln_caustic_techniques){.aims = l->aims,
                                                     .emission = l->emission,
                                                     .images = l->images,
                                                     .mis = params->settings->mis,
                                                     .kept = l->kept,
                                                     .connections = params->settings->connections};
    if (status != KILN_OK)
        kiln_landing_destroy(landing);
    return status;
}

void kiln_landing_end(struct kiln_landing *l)
{
    kiln_backend_destroy(&l->own);
    kiln_land_exchange_release(&l->exchange);
    kiln_merge_destroy(&l->merge);
    kiln_land_factors_release(&l->factors);
    kiln_free(&l->moments_of_rays);
    kiln_free(&l->records);
    kiln_free(&l->sums);
    kiln_free(&l->lit);
    kiln_free(&l->merged);
    kiln_free(&l->gathered);
}

void kiln_landing_destroy(struct kiln_landing **landing)
{
    struct kiln_landing *l = *landing;
    if (l == NULL)
        return;
    kiln_landing_end(l);
    kiln_aims_destroy(&l->aims);
    kiln_aims_destroy(&l->kept);
    kiln_emission_destroy(&l->emission);
    kiln_mirror_images_destroy(&l->images);
    kiln_free(&l->moments);
    kiln_free(&l->moments_before);
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
    const uint64_t moment = a->aims[aim].flux > 0.0 ? (uint64_t)fmin(MOMENT_STEP * flux * flux, MOMENT_MOST) : 0;
#pragma omp atomic
    l->moments[aim] += moment;
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
        if (l->exchange.weights != NULL && l->exchange.weights->factors != NULL)
            record->sampled = r->sampled;
        if (!shares(l))
            note_moment(l, r->aim, kiln_luminance_of_floats(r->flux));
    }
    return KILN_OK;
}

/* Runs a pass where it can be run (kiln_landing_host). */
static int run_pass(struct kiln_landing *l, const struct kiln_pass *pass, const void *parameters,
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
    const struct kiln_land_parameters parameters = {.aims = l->aims, .techniques = shares(l) ? &l->techniques : NULL};
    const struct kiln_batch batch = {.first = first, .count = count, .take = take, .context = l};
    return run_pass(l, &kiln_pass_land, &parameters, &batch, rays, error);
}

/* Collective. A checkpoint has nothing of the block under way, which is traced anew then. */
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

/* Does some of this rank's work, and adds its rays. */
typedef int (*do_some)(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays,
                       struct kiln_error *error);

/* Collective. Does the work [begin, end) of this rank, so much at once, and waits for the others; saves and stops when
 * that is asked for. */
static int work_through(struct kiln_landing *l, uint64_t begin, uint64_t end, uint64_t at_once, do_some work,
                        int status, struct kiln_error *error)
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

/* How much of a pass's work is handed over at once. */
static uint64_t at_once(const struct kiln_landing *l, uint64_t of_the_host)
{
    struct kiln_backend_info info;
    kiln_backend_info(l->params->backend, &info);
    return strcmp(info.name, "embree") == 0 ? of_the_host : OF_A_DEVICE * of_the_host;
}

/* Collective. Traces this rank's part of the block of paths [first, first + count). */
static int trace_block(struct kiln_landing *l, uint64_t first, uint64_t count, struct kiln_error *error)
{
    const uint64_t rank = (uint64_t)l->params->rank, ranks = (uint64_t)l->params->ranks;
    l->count = 0;
    l->first_path = first;
    memcpy(l->moments_before, l->moments, l->aims->count * sizeof *l->moments);
    return work_through(l, first + count * rank / ranks, first + count * (rank + 1) / ranks, at_once(l, BATCH_PATHS),
                        trace, KILN_OK, error);
}

/* ---- aims ---- */

/* Shares `paths` of the next iteration out by what was learnt. */
static void aim(struct kiln_landing *l, uint64_t paths)
{
    kiln_aims_weigh(l->aims, l->learnt, l->paths, shares(l) ? EVEN : 0.0, l->weights);
    kiln_aims_share(l->aims, paths, l->weights);
    if (l->kept != NULL)
        kiln_aims_share(l->kept, kept_paths(l->aims->count, (double)l->params->surface->point_count), l->weights);
}

/* Collective. Adds an iteration's moments to those learnt, and shares `paths` of the next one out. */
static void correct_aims(struct kiln_landing *l, uint64_t paths)
{
    struct kiln_aims *a = l->aims;
    (void)MPI_Allreduce(MPI_IN_PLACE, l->moments, (int)a->count, MPI_UINT64_T, MPI_SUM, l->params->communicator);
    for (size_t i = 0; i < a->count; i++) {
        l->learnt[i] += (double)l->moments[i] / MOMENT_STEP;
        l->paths[i] += (double)(a->first[i + 1] - a->first[i]);
        l->moments[i] = 0;
    }
    aim(l, paths);
}

static void forget(struct kiln_landing *l)
{
    const size_t count = l->aims->count;
    memset(l->moments, 0, count * sizeof *l->moments);
    memset(l->learnt, 0, count * sizeof *l->learnt);
    memset(l->paths, 0, count * sizeof *l->paths);
    kiln_aims_share(l->aims, l->photons, NULL);
    l->iteration = l->done = 0;
    l->pilots = l->restored = false;
    l->radius = l->params->settings->merge_radius;
}

/* ---- a step ---- */

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

/* Of an own tile run: no path meets it. */
static bool is_receiver(const struct kiln_landing *l, size_t tile_run)
{
    const struct kiln_surface *s = &l->solution->own->surface;
    const uint32_t object = kiln_map_object(s, s->tile_runs[tile_run].map);
    return (l->params->backend->params.scene->objects[object].flags & KILN_OBJECT_RECEIVER_ONLY) != 0;
}

/* The end of the own tile runs from `first` on, before `end`, that paths meet, or do not, alike. */
static size_t same_kind(const struct kiln_landing *l, size_t first, size_t end)
{
    size_t next = first + 1;
    while (next < end && is_receiver(l, next) == is_receiver(l, first))
        next++;
    return next;
}

static void find_lit(const struct kiln_landing *l)
{
    const struct kiln_surface *s = &l->solution->own->surface;
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)l->params->threads)
    for (size_t f = 0; f < s->tile_run_count; f++) {
        struct kiln_point_cursor at = kiln_point_first(s, f);
        for (uint32_t k = 0; k < s->tile_runs[f].count; k++, kiln_point_next(s, &at))
            if (kiln_point_valid(s, at.point) && !is_receiver(l, f))
                l->lit[at.point.at] = (float)kiln_lit_area(s, at.point, presence(l, s, &at));
    }
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
    if (status == KILN_OK && (merges(l) || shares(l)))
        status = kiln_allocate(&l->lit, own->count, sizeof *l->lit, "the areas of points", error);
    if (status == KILN_OK && (merges(l) || spreads(l)))
        status = kiln_allocate(&l->merged, own->count, sizeof *l->merged, "the light that is merged", error);
    if (status == KILN_OK && spreads(l))
        status = kiln_allocate(&l->gathered, own->count, sizeof *l->gathered, "the light that rays find", error);
    status = kiln_agree(l->params->communicator, status, error);
    if (status == KILN_OK && l->lit != NULL)
        find_lit(l);
    if (status == KILN_OK)
        status = kiln_land_exchange_create(&l->exchange, l->params->communicator, own->first.at, own->count, error);
    l->landing_weights = (struct kiln_landing_weights){
        .mis = l->techniques.mis, .rays = (double)kiln_solution_step(l->solution)->step.samples, .area = l->lit};
    l->techniques.first_kept = KEPT_ITERATION + kiln_solution_step(l->solution)->step.part * KEPT_QUARTERS;
    l->exchange.weights = shares(l) ? &l->landing_weights : NULL;
    l->exchange.threads = l->params->threads;
    l->techniques.factors = NULL;
    l->techniques.iterations = iterations_of(l);
    if (status == KILN_OK && has_factors(l))
        status = kiln_agree(l->params->communicator, kiln_land_factors_create(&l->factors, own, error), error);
    return status;
}

/* From now on techniques count by their factors. */
static void use_factors(struct kiln_landing *l)
{
    l->techniques.factors = l->landing_weights.factors = l->factors.of;
    l->techniques.region_of = l->landing_weights.region_of = l->factors.region_of;
}

/* ---- checkpoints ---- */

size_t kiln_landing_blocks(struct kiln_landing *l, struct kiln_block blocks[KILN_LANDING_BLOCKS])
{
    const struct kiln_surface *own = &l->solution->own->surface;
    const uint64_t first = own->first.at, aims = l->aims->count;
    size_t count = 0;
    if (l->sums == NULL || l->pilots)
        return 0;
    l->record = (struct saved_landing){.step = l->solution->report.steps.count,
                                       .iteration = l->iteration,
                                       .done = l->done,
                                       .photons = l->photons,
                                       .aims = aims,
                                       .radius = l->radius};
    if (l->params->rank == 0) {
        blocks[count++] = (struct kiln_block){"landing", 0, 1, sizeof l->record, &l->record};
        blocks[count++] = (struct kiln_block){"landing_learnt", 0, aims, sizeof *l->learnt, l->learnt};
        blocks[count++] = (struct kiln_block){"landing_paths", 0, aims, sizeof *l->paths, l->paths};
        if (has_factors(l))
            blocks[count++] =
                (struct kiln_block){"landing_factors", 0, l->factors.regions, sizeof *l->factors.of, l->factors.of};
    }
    blocks[count++] = (struct kiln_block){"landing_moments", 0, aims, sizeof *l->moments_before, l->moments_before};
    blocks[count++] = (struct kiln_block){"landing_sums", first, own->count, sizeof *l->sums, l->sums};
    if (merges(l))
        blocks[count++] = (struct kiln_block){"landing_merged", first, own->count, sizeof *l->merged, l->merged};
    return count;
}

/* Adds the moments of a file to this rank's: which rank does that makes no difference to the sum. */
static int add_moments(struct kiln_landing *l, size_t part, struct kiln_error *error)
{
    uint64_t *moments = NULL, count = 0;
    const int status = kiln_checkpoint_read_part(l->params->checkpoint, part, "landing_moments", sizeof *moments,
                                                 &moments, &count, error);
    for (uint64_t i = 0; status == KILN_OK && i < count && i < l->aims->count; i++)
        l->moments[i] += moments[i];
    kiln_free(&moments);
    return status;
}

static bool is_sane(const struct kiln_landing *l, const struct saved_landing *s)
{
    bool sane = s->photons == l->photons && s->aims == l->aims->count && s->iteration <= iterations_of(l) &&
                s->done <= s->photons && isfinite(s->radius);
    for (size_t i = 0; i < l->aims->count && sane; i++)
        sane = isfinite(l->learnt[i]) && l->learnt[i] >= 0.0 && isfinite(l->paths[i]) &&
               ((s->iteration == 0 && !shares(l)) || l->paths[i] > 0.0);
    return sane;
}

static int read_landing(struct kiln_landing *l, const struct saved_landing *s, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = l->params->checkpoint;
    const struct kiln_surface *own = &l->solution->own->surface;
    const uint64_t first = own->first.at, aims = l->aims->count;
    int status = kiln_checkpoint_read(c, "landing_learnt", 0, aims, sizeof *l->learnt, l->learnt, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_read(c, "landing_paths", 0, aims, sizeof *l->paths, l->paths, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_read(c, "landing_sums", first, own->count, sizeof *l->sums, l->sums, error);
    if (status == KILN_OK && merges(l))
        status = kiln_checkpoint_read(c, "landing_merged", first, own->count, sizeof *l->merged, l->merged, error);
    for (size_t part = (size_t)l->params->rank; status == KILN_OK && part < kiln_checkpoint_parts(c);
         part += (size_t)l->params->ranks)
        status = add_moments(l, part, error);
    if (status == KILN_OK && has_factors(l))
        status = kiln_checkpoint_read(c, "landing_factors", 0, l->factors.regions, sizeof *l->factors.of, l->factors.of,
                                      error);
    return status == KILN_OK && !(is_sane(l, s) && kiln_land_factors_sane(&l->factors))
               ? kiln_block_insane("landing", error)
               : status;
}

/* Collective. Takes over what a checkpoint within this step has. */
static int restore(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = l->params->checkpoint;
    struct saved_landing s = {0};
    int status = KILN_OK;
    const bool any = !l->begun && c != NULL && kiln_checkpoint_generation(c) != 0 && kiln_checkpoint_has(c, "landing");
    l->begun = true;
    if (any)
        status = kiln_checkpoint_read(c, "landing", 0, 1, sizeof s, &s, error);
    const bool here = any && s.step == l->solution->report.steps.count;
    if (status == KILN_OK && here)
        status = read_landing(l, &s, error);
    status = kiln_agree(l->params->communicator, status, error);
    if (!here)
        kiln_solution_step(l->solution)->rays = 0; /* of paths that are traced again */
    if (status != KILN_OK || !here)
        return status;
    l->iteration = s.iteration;
    l->done = s.done;
    l->radius = s.radius;
    l->restored = true;
    if (has_factors(l))
        use_factors(l);
    if (shares(l) || (l->iteration > 0 && l->iteration < iterations_of(l)))
        aim(l, l->photons); /* gather rays weigh by the same shares */
    return KILN_OK;
}

/* ---- iterations ---- */

/* kiln_take_landing: its light counts. */
static void add_landing(void *context, const struct kiln_landing_record *record, double weight)
{
    struct kiln_landing *l = context;
    kiln_land_add(record, weight, &l->sums[record->point - l->exchange.first[l->exchange.rank]]);
}

/* kiln_take_landing: of a pilot, for the exchanges: of all that will land. */
static void learn_from_exchange(void *context, const struct kiln_landing_record *record, double weight)
{
    struct kiln_landing *l = context;
    const uint64_t own = record->point - l->exchange.first[l->exchange.rank];
    const double iterations = (double)iterations_of(l), less = (double)l->aims->paths / (double)l->photons,
                 area = (double)l->lit[own] * iterations;
    if (!(area > 0.0))
        return;
    const double light = weight * kiln_luminance_of_floats(record->flux) * less / area,
                 more = light * kiln_caustic_exchange_landed(weight);
    float *product = l->moments_of_rays[own].product;
    product[2] += (float)(more * more * iterations / less);
    product[4] += (float)(more * light * iterations / less);
}

/* kiln_take_landing: of a pilot, whose light does not count. */
static void learn_from_landing(void *context, const struct kiln_landing_record *record, double weight)
{
    note_moment(context, record->aim, weight * kiln_luminance_of_floats(record->flux));
}

/* Collective. The rest of the paths of an iteration, by its number among all of the bake. `before`: paths before them,
 * for the progress. */
static int run_paths(struct kiln_landing *l, uint64_t number, uint64_t before, kiln_take_landing take_landing,
                     struct kiln_error *error)
{
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    const uint64_t paths = l->aims->paths;
    int status = KILN_OK;
    while (l->done < paths && status == KILN_OK) {
        const uint64_t count = paths - l->done < KILN_LAND_BLOCK ? paths - l->done : KILN_LAND_BLOCK;
        status = trace_block(l, number * paths + l->done, count, error);
        const double start = MPI_Wtime();
        kiln_control_blocking(l->params->control, "exchanging landings of light", 0.0);
        if (status == KILN_OK)
            status = kiln_land_exchange(&l->exchange, l->records, l->count, take_landing, l, error);
        kiln_control_blocking(l->params->control, NULL, 0.0);
        report->exchange_seconds += MPI_Wtime() - start;
        l->done += count;
        kiln_progress_advance(l->params->progress, before + l->done);
    }
    return status;
}

/* Paths of a round of pilots; 0: there are none. */
static uint64_t pilot_paths(const struct kiln_landing *l)
{
    const uint64_t paths = l->photons / PILOTS;
    return !gathers(l) ? 0 : paths > l->aims->count ? paths : l->aims->count;
}

/* Of all rounds. */
static uint64_t all_pilots(const struct kiln_landing *l)
{
    return (exchanges(l) ? PILOTS + 1 : PILOTS) * pilot_paths(l);
}

static uint32_t pilot_rays(const struct kiln_step *step)
{
    const uint32_t part = step->samples / PILOT_PART / 4 * 4;
    return part > PILOT_RAYS ? part : PILOT_RAYS;
}

/* Of tile runs, gather rays that bring no light. */
static int gather_pilots(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays,
                         struct kiln_error *error)
{
    const struct kiln_step *step = &kiln_solution_step(l->solution)->step;
    struct kiln_caustic_techniques techniques = l->techniques;
    techniques.moments = l->moments_of_rays;
    techniques.rays = step->samples;
    const struct kiln_batch batch = {.first = (size_t)first,
                                     .count = (size_t)count,
                                     .stream = step->stream + PILOT_STREAM,
                                     .samples = pilot_rays(step),
                                     .first_sample = step->part * pilot_rays(step)};
    return run_pass(l, &kiln_pass_weighed, &techniques, &batch, rays, error);
}

/* Collective. `paths` pilots that land, weighed as if they were all that will land: what they exchange with gather rays
 * teaches what is best. */
static int land_pilots(struct kiln_landing *l, uint64_t paths, struct kiln_error *error)
{
    const uint64_t iterations = l->techniques.iterations;
    aim(l, paths);
    l->techniques.iterations = iterations * (l->photons / paths);
    const int status = run_paths(l, EXCHANGE_ITERATION + kiln_solution_step(l->solution)->step.part, PILOTS * paths,
                                 learn_from_exchange, error);
    l->techniques.iterations = iterations;
    l->done = 0;
    aim(l, l->photons);
    return status;
}

/* Collective. Pilot rays of all points, and where techniques exchange `paths` that land, teach how the techniques
 * count. */
static int learn_factors(struct kiln_landing *l, uint64_t paths, struct kiln_error *error)
{
    const struct kiln_surface *own = &l->solution->own->surface;
    int status =
        kiln_allocate(&l->moments_of_rays, own->count, sizeof *l->moments_of_rays, "the moments of rays", error);
    status = work_through(l, 0, own->tile_run_count, PILOT_TILE_RUNS, gather_pilots, status, error);
    if (status == KILN_OK)
        use_factors(l);
    if (status == KILN_OK && exchanges(l))
        status = land_pilots(l, paths, error);
    if (status == KILN_OK)
        status = kiln_land_factors_find(&l->factors, l->params->communicator, l->techniques.mis, l->moments_of_rays,
                                        own, error);
    kiln_free(&l->moments_of_rays);
    return status;
}

/* Collective. Paths that teach how those of all iterations are shared out, in a few rounds of which each learns from
 * those before, and bring no light. */
static int run_pilots(struct kiln_landing *l, struct kiln_error *error)
{
    const uint64_t paths = pilot_paths(l), part = kiln_solution_step(l->solution)->step.part;
    int status = KILN_OK;
    l->pilots = true;
    kiln_aims_share(l->aims, paths, NULL);
    for (uint64_t i = 0; i < PILOTS && status == KILN_OK; i++) {
        status = run_paths(l, PILOT_ITERATION + part * PILOTS + i, i * paths, learn_from_landing, error);
        if (status == KILN_OK)
            correct_aims(l, i + 1 < PILOTS ? paths : l->photons);
        l->done = 0;
    }
    if (status == KILN_OK && has_factors(l))
        status = learn_factors(l, paths, error);
    l->pilots = false;
    return status;
}

/* Collective. Where no radius was given the first iteration shows it; a largest one is so many texels. */
static int find_radius(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const double power = kiln_luminance(p->emission->emitted), points = (double)p->surface->point_count,
                 texel = points > 0.0 ? sqrt(p->area / points) : 0.0;
    const struct kiln_merge_search search = {.landed = l->sums,
                                             .merged = l->merged,
                                             .iterations = iterations_of(l),
                                             .alpha = p->settings->radius_alpha,
                                             .texel = texel,
                                             .scale = p->area > 0.0 ? power * power / p->area : 0.0};
    if (shares(l)) {
        l->radius = p->settings->merge_radius == KILN_MERGE_RADIUS_AUTO ? LARGEST * texel : p->settings->merge_radius;
        return KILN_OK;
    }
    return l->iteration == 0 && p->settings->merge_radius == KILN_MERGE_RADIUS_AUTO
               ? kiln_merge_find_radius(l->merge, &search, &l->radius, error)
               : KILN_OK;
}

/* Collective. */
static int begin_merging(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const struct kiln_merge_params params = {.communicator = p->communicator,
                                             .world = &p->backend->params,
                                             .surface = &l->solution->own->surface,
                                             .lit = l->lit,
                                             .threads = p->threads};
    int status = kiln_merge_create(&l->merge, &params, error);
    if (status == KILN_OK)
        status = find_radius(l, error);
    l->solution->report.landing.radius = fmax(l->radius, 0.0);
    return status == KILN_OK ? kiln_merge_set_radius(l->merge, l->radius, error) : status;
}

/* Landings that a point's light is to hang on: more of more iterations, so that radii fall as those of merge.h do. */
static double landings_of(const struct kiln_landing *l)
{
    return LANDINGS * pow((double)iterations_of(l), l->params->settings->radius_alpha);
}

/* Collective. What has landed in iterations of one radius goes to the points within it. */
static int merge_iterations(struct kiln_landing *l, struct kiln_error *error)
{
    const double radius = kiln_merge_radius_of(fmax(l->radius, 0.0), l->params->settings->radius_alpha, l->iteration);
    const int status = kiln_merge_spread(l->merge, l->sums, radius, l->merged, error);
    memset(l->sums, 0, l->solution->own->surface.count * sizeof *l->sums);
    return status;
}

/* Collective. What has landed in all iterations and what rays have found goes to the points within the radius of each.
 */
static int spread_all(struct kiln_landing *l, struct kiln_error *error)
{
    const int status = kiln_merge_fit(l->merge, l->gathered, landings_of(l), error);
    return status == KILN_OK ? kiln_merge_spread(l->merge, l->gathered, l->radius, l->merged, error) : status;
}

/* Collective. Does one or the other. */
static int merge_sums(struct kiln_landing *l, int (*merge)(struct kiln_landing *, struct kiln_error *),
                      struct kiln_error *error)
{
    const double start = MPI_Wtime();
    kiln_control_blocking(l->params->control, "merging landings of light", 0.0);
    int status = l->merge == NULL ? begin_merging(l, error) : KILN_OK;
    if (status == KILN_OK)
        status = merge(l, error);
    kiln_control_blocking(l->params->control, NULL, 0.0);
    kiln_solution_step(l->solution)->seconds += MPI_Wtime() - start;
    return status;
}

/* What rays found at a point, as the flux of one landing more, whose luminance squared is its variance. */
static void add_gathered(const struct kiln_point_result *result, double area, double iterations,
                         struct kiln_landing_sum *sum)
{
    const struct kiln_point_mean mean = kiln_point_mean(result);
    const double scale = area * iterations, error = (double)mean.error * scale;
    for (int c = 0; c < 3; c++) {
        sum->irradiance[c] += (double)mean.irradiance[c] * scale;
        sum->incident[c] += (double)mean.incident[c] * scale;
    }
    sum->square += error * error;
    sum->count += kiln_luminance_of_floats(mean.irradiance) + kiln_luminance_of_floats(mean.incident) > 0.0;
}

/* kiln_take_results */
static int take_rays(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct kiln_landing *l = context;
    const struct kiln_surface *surface = &l->solution->own->surface;
    const struct kiln_point_result *next = results;
    for (size_t f = first; f < first + count; f++) {
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        for (uint32_t k = 0; k < surface->tile_runs[f].count; k++, next++, kiln_point_next(surface, &at))
            add_gathered(next, (double)l->lit[at.point.at], (double)iterations_of(l), &l->gathered[at.point.at]);
    }
    return KILN_OK;
}

/* The gather rays of tile runs, before their answers are given: which counts them. */
static int gather_rays(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays, struct kiln_error *error)
{
    (void)rays;
    const struct kiln_step *step = &kiln_solution_step(l->solution)->step;
    struct kiln_batch batch = {.stream = step->stream,
                               .samples = step->samples,
                               .first_sample = step->first_sample,
                               .take = take_rays,
                               .context = l};
    const struct kiln_tile_run *runs = l->solution->own->surface.tile_runs;
    uint64_t now = 0;
    int status = KILN_OK;
    for (size_t f = (size_t)first, end = (size_t)(first + count); f < end && status == KILN_OK; f += batch.count) {
        batch.first = f;
        batch.count = same_kind(l, f, end) - f;
        if (!is_receiver(l, f))
            status = run_pass(l, &kiln_pass_weighed, &l->techniques, &batch, &now, error);
    }
    if (status == KILN_OK)
        kiln_progress_advance(l->params->progress, kiln_tile_runs_points(runs, runs + first + count - 1));
    return status;
}

/* Collective. The rays of all own points, and with what has landed that is spread. A checkpoint has nothing of them:
 * a bake that goes on gathers again. */
static int spread_rays_and_paths(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const struct kiln_surface *own = &l->solution->own->surface;
    memcpy(l->gathered, l->sums, own->count * sizeof *l->sums);
    kiln_progress_phase(p->progress, "caustics by rays", p->surface->count);
    kiln_control_begin(p->control, "caustics by rays");
    const int status =
        work_through(l, 0, own->tile_run_count, at_once(l, RAY_TILE_RUNS * p->threads), gather_rays, KILN_OK, error);
    return status == KILN_OK ? merge_sums(l, spread_all, error) : status;
}

/* Collective. All iterations that are to do. */
static int run_iterations(struct kiln_landing *l, struct kiln_error *error)
{
    const uint64_t iterations = iterations_of(l), number = kiln_solution_step(l->solution)->step.first_iteration;
    int status = KILN_OK;
    while (l->iteration < iterations && status == KILN_OK) {
        status = run_paths(l, number + l->iteration, all_pilots(l) + l->iteration * l->photons, add_landing, error);
        if (status == KILN_OK && merges(l) && (kiln_merge_radius_ends(l->iteration) || l->iteration + 1 == iterations))
            status = merge_sums(l, merge_iterations, error);
        if (status == KILN_OK && l->iteration + 1 < iterations && !shares(l))
            correct_aims(l, l->photons);
        l->iteration++;
        l->done = 0;
    }
    return status == KILN_OK && spreads(l) ? spread_rays_and_paths(l, error) : status;
}

int kiln_landing_run(struct kiln_landing *l, struct kiln_error *error)
{
    const uint64_t iterations = iterations_of(l), pilots = all_pilots(l);
    forget(l);
    kiln_landing_end(l);
    int status = begin_step(l, error);
    if (status == KILN_OK)
        status = restore(l, error);
    kiln_progress_phase(l->params->progress, "light paths", pilots + iterations * l->photons);
    kiln_progress_advance(l->params->progress, l->restored ? pilots + l->iteration * l->photons + l->done : 0);
    kiln_control_begin(l->params->control, "light paths");
    if (status == KILN_OK && pilots > 0 && !l->restored)
        status = run_pilots(l, error);
    return status == KILN_OK && l->aims->count > 0 ? run_iterations(l, error) : status;
}

/* ---- answers ---- */

static struct kiln_point_result answer(const struct kiln_landing *l, const struct kiln_surface *surface,
                                       const struct kiln_point_cursor *at)
{
    const struct kiln_landing_sum *sum = &l->sums[at->point.at];
    struct kiln_point_result r = {.present = 1.0f, .count = 1};
    if (!kiln_point_valid(surface, at->point))
        return (struct kiln_point_result){.count = 0};
    r.present = presence(l, surface, at);
    const double area = kiln_lit_area(surface, at->point, r.present),
                 scale = area > 0.0 ? 1.0 / (area * (double)iterations_of(l)) : 0.0;
    for (int c = 0; c < 3; c++) {
        r.irradiance[c] = (float)(sum->irradiance[c] * scale);
        r.incident[c] = (float)(sum->incident[c] * scale);
    }
    r.error = (float)(sqrt(sum->square) * scale);
    return r;
}

/* What is spread has the rays of the step. */
static struct kiln_point_result merged_answer(const struct kiln_landing *l, const struct kiln_surface *surface,
                                              const struct kiln_point_cursor *at)
{
    const struct kiln_merged *merged = &l->merged[at->point.at];
    const uint64_t iterations = iterations_of(l);
    struct kiln_point_result r = {.count = spreads_rays(l) ? kiln_solution_step(l->solution)->step.samples : 1};
    const double count = (double)r.count;
    if (!kiln_point_valid(surface, at->point))
        return (struct kiln_point_result){.count = 0};
    r.present = presence(l, surface, at);
    for (int c = 0; c < 3; c++) {
        r.irradiance[c] = (float)(count * merged->irradiance[c] / (double)iterations);
        r.incident[c] = (float)(count * merged->incident[c] / (double)iterations);
    }
    r.error = (float)(count * kiln_merge_error(merged, iterations));
    return r;
}

/* Tile runs that no path meets gather their caustics. */
static int gather(struct kiln_landing *l, const struct kiln_batch *batch, size_t first, size_t end,
                  struct kiln_error *error)
{
    struct kiln_batch part = *batch;
    part.first = first;
    part.count = end - first;
    return kiln_backend_run(l->params->backend, &kiln_pass_caustic, NULL, &part, &kiln_solution_step(l->solution)->rays,
                            error);
}

static int give(struct kiln_landing *l, const struct kiln_batch *batch, size_t first, size_t end,
                struct kiln_error *error)
{
    const struct kiln_surface *surface = &l->solution->own->surface;
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    size_t count = 0;
    for (size_t f = first; f < end; f++) {
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        for (uint32_t k = 0; k < surface->tile_runs[f].count; k++, kiln_point_next(surface, &at)) {
            struct kiln_point_result *r = &l->results[count++];
            *r = merges(l) || spreads_rays(l) ? merged_answer(l, surface, &at) : answer(l, surface, &at);
            report->rays += spreads_rays(l) ? r->count : 0;
        }
    }
    return batch->take(batch->context, first, end - first, l->results, error);
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

/* A batch of which gather rays find a part that is not spread. */
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

/* Gather rays of tile runs, which find what light paths leave to them. */
static int give_gathered(struct kiln_landing *l, const struct kiln_batch *batch, size_t first, size_t end,
                         struct kiln_error *error)
{
    struct gathered g = {l, batch};
    struct kiln_batch rays = *batch;
    rays.first = first;
    rays.count = end - first;
    rays.take = take_gathered;
    rays.context = &g;
    return run_pass(l, &kiln_pass_weighed, &l->techniques, &rays, &kiln_solution_step(l->solution)->rays, error);
}

int kiln_landing_give(struct kiln_landing *l, const struct kiln_batch *batch, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t first = batch->first, end = batch->first + batch->count, next; first < end && status == KILN_OK;
         first = next) {
        const bool receiver = is_receiver(l, first), rays = !receiver && gathers(l) && !spreads(l);
        const size_t most = receiver || rays || end - first < GIVEN_TILE_RUNS ? end : first + GIVEN_TILE_RUNS;
        next = same_kind(l, first, most);
        status = receiver ? gather(l, batch, first, next, error)
                 : rays   ? give_gathered(l, batch, first, next, error)
                          : give(l, batch, first, next, error);
    }
    return status;
}
