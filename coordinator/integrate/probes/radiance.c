#include "coordinator/integrate/probes/radiance.h"

#include <math.h>
#include <string.h>

#include "coordinator/run/control.h"
#include "coordinator/integrate/probes/radiance_report.h"
#include "coordinator/integrate/probes/radiance_grid.h"
#include "coordinator/integrate/probes/radiance_sight.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/integrate/companion.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"

#define MOST_BACKS                                                                                                     \
    0.25 /* largest fraction of directions that may hit backs; with more, the probe is inside geometry                 \
          */

enum {
    BATCH_ITEMS = 1 << 18, /* map elements in a batch of probes; rays in a batch of tile runs' points */
    BATCH_TILE_RUNS = 1 << 10,
    SEARCH_SIDE = 8, /* side of the maps used to judge places for probes */
    SEARCH_ELEMENTS = SEARCH_SIDE * SEARCH_SIDE,
    CANDIDATES = 52,
    PLACING_STREAM = 0x706c6163
};

struct kiln_radiance {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    const struct kiln_saved *saved;
    bool placed;
    uint64_t probes, first, count; /* of all ranks; this rank's range */
    uint32_t elements, samples;    /* of a probe's map; rays of each */
    struct kiln_radiance_probes set;
    struct kiln_vec3 *positions;
    float *data;
    struct kiln_probe_element *element;
    /* of a batch */
    uint64_t batch_probes;
    struct kiln_vec3 *places;
    struct kiln_radiance_result *results;
    uint32_t stream;
    uint64_t rays;
};

int kiln_radiance_create(struct kiln_radiance **radiance, const struct kiln_integrate_params *params,
                         struct kiln_solution *solution, const struct kiln_saved *saved, struct kiln_error *error)
{
    struct kiln_radiance *r = NULL;
    const struct kiln_radiance_settings *settings = params->settings->radiance;
    const char *what = "the radiance probes";
    int status = kiln_allocate(&r, 1, sizeof *r, what, error);
    *radiance = r;
    if (status != KILN_OK)
        return status;
    r->params = params;
    r->solution = solution;
    r->saved = saved;
    KILN_TRY(kiln_probe_grid_make(&r->set.grid, settings, params->backend->params.geometry, error));
    r->probes = kiln_probes_count(&r->set.grid);
    r->first = r->probes * (uint64_t)params->rank / (uint64_t)params->ranks;
    r->count = r->probes * ((uint64_t)params->rank + 1) / (uint64_t)params->ranks - r->first;
    r->elements = kiln_probe_elements(r->set.grid.basis, r->set.grid.side);
    r->samples = kiln_probe_element_samples(&r->set.grid, settings);
    r->batch_probes = r->elements < BATCH_ITEMS ? BATCH_ITEMS / r->elements : 1;
    KILN_TRY(kiln_allocate(&r->positions, r->probes, sizeof *r->positions, what, error));
    const size_t items = (size_t)r->batch_probes * r->elements, room = items > BATCH_ITEMS ? items : BATCH_ITEMS;
    KILN_TRY(kiln_allocate(&r->data, r->probes * r->set.grid.floats, sizeof *r->data, what, error));
    KILN_TRY(kiln_allocate(&r->element, r->elements, sizeof *r->element, what, error));
    KILN_TRY(kiln_allocate(&r->places, room, sizeof *r->places, what, error));
    KILN_TRY(kiln_allocate(&r->results, room, sizeof *r->results, what, error));
end:
    r->set.positions = r->positions;
    r->set.data = r->data;
    if (status == KILN_OK) {
        kiln_probe_elements_make(&r->set.grid, r->element);
        solution->report.radiance =
            (struct kiln_radiance_report){.probes = r->probes,
                                          .bytes = r->probes * r->set.grid.floats * sizeof(float),
                                          .spacing = (double)r->set.grid.spacing,
                                          .side = r->set.grid.side,
                                          .samples = r->samples * r->elements};
    }
    if (status != KILN_OK)
        kiln_radiance_destroy(radiance);
    return status;
}

void kiln_radiance_destroy(struct kiln_radiance **radiance)
{
    struct kiln_radiance *r = *radiance;
    if (r == NULL)
        return;
    struct kiln_error ignored;
    if (r->placed)
        (void)kiln_backend_set_probes(r->params->backend, NULL, &ignored);
    r->params->surface->near_probes = NULL;
    kiln_free(&r->positions);
    kiln_free(&r->data);
    kiln_free(&r->element);
    kiln_free(&r->places);
    kiln_free(&r->results);
    kiln_free(radiance);
}

/* ---- batches on all ranks ---- */

typedef int (*radiance_batch)(struct kiln_radiance *r, uint64_t first, uint64_t count, struct kiln_error *error);

/* Collective. Calls `batch` for this rank's items [0, count), at most `most` at once, until all ranks are done. Saves
 * and stops on request. */
static int run_all(struct kiln_radiance *r, radiance_batch batch, uint64_t count, uint64_t most,
                   struct kiln_error *error)
{
    const struct kiln_integrate_params *p = r->params;
    uint64_t next = 0, some = most / 16 + 1;
    int status = KILN_OK;
    kiln_control_begin(p->control, "radiance probes");
    for (;;) {
        enum kiln_event event;
        if (status == KILN_OK && next < count) {
            const double start = MPI_Wtime();
            const uint64_t now = count - next < some ? count - next : some;
            status = batch(r, next, now, error);
            next += now;
            const double seconds = MPI_Wtime() - start;
            if (seconds < 0.5 * kiln_control_batch_seconds(p->control))
                some = 2 * some < most ? 2 * some : most;
            else if (seconds > 2.0 * kiln_control_batch_seconds(p->control) && some > 1)
                some /= 2;
            event = kiln_control_poll(p->control, next == count, (double)next / (double)count, seconds, status);
        } else {
            event = kiln_control_wait(p->control, true, 1.0, status, NULL, NULL);
        }
        if (event == KILN_EVENT_FAIL || event == KILN_EVENT_DONE)
            return kiln_agree(p->communicator, status, error);
        if (event == KILN_EVENT_STOP)
            return kiln_save_and_stop(r->saved, false, error);
        if (event == KILN_EVENT_SAVE) {
            const int saved = kiln_save(r->saved, false, error);
            if (saved != KILN_OK)
                return saved;
        }
    }
}

/* Collective. Hands each rank's range of `values`, `bytes` a probe, to all. */
static int share(const struct kiln_radiance *r, void *values, size_t bytes, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = r->params;
    int *counts = NULL, *places = NULL;
    int status = kiln_allocate(&counts, (size_t)p->ranks, sizeof *counts, "the ranks' probes", error);
    if (status == KILN_OK)
        status = kiln_allocate(&places, (size_t)p->ranks, sizeof *places, "the ranks' probes", error);
    status = kiln_agree(p->communicator, status, error);
    if (status == KILN_OK) {
        MPI_Datatype probe;
        for (int i = 0; i < p->ranks; i++) {
            places[i] = (int)(r->probes * (uint64_t)i / (uint64_t)p->ranks);
            counts[i] = (int)(r->probes * ((uint64_t)i + 1) / (uint64_t)p->ranks) - places[i];
        }
        (void)MPI_Type_contiguous((int)bytes, MPI_BYTE, &probe);
        (void)MPI_Type_commit(&probe);
        (void)MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, values, counts, places, probe, p->communicator);
        (void)MPI_Type_free(&probe);
    }
    kiln_free(&counts);
    kiln_free(&places);
    return status;
}

/* ---- rays of probes ---- */

/* Where the results of a batch go. */
struct taking {
    struct kiln_radiance_result *results;
    size_t first;
};

/* kiln_take_results */
static int take(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    const struct taking *t = context;
    memcpy(t->results + (first - t->first), results, count * sizeof *t->results);
    return KILN_OK;
}

/* Runs the pass over `count` items from `first` on, whose places and results stand at the begin of the arrays. */
static int run_pass(struct kiln_radiance *r, const struct kiln_radiance_parameters *map, size_t first, size_t count,
                    uint32_t samples, uint32_t stream, struct kiln_error *error)
{
    struct taking taking = {r->results, first};
    const struct kiln_batch batch = {.first = first,
                                     .count = count,
                                     .positions = r->places,
                                     .stream = stream,
                                     .samples = samples,
                                     .take = take,
                                     .context = &taking};
    return kiln_backend_run(r->params->backend, &kiln_pass_radiance, map, &batch, &r->rays, error);
}

/* The maps of this rank's probes [first, first + count). */
static int run_probes(struct kiln_radiance *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    const struct kiln_radiance_parameters map = {r->set.grid.basis, r->set.grid.side, 0};
#pragma omp parallel for num_threads((int)r->params->threads) schedule(static)
    for (uint64_t i = 0; i < count * r->elements; i++) {
        const uint64_t probe = r->first + first + i / r->elements;
        /* its rays hit geometry, but nobody reads the result */
        const bool off = kiln_probe_is_off(&r->set, (uint32_t)probe);
        r->places[i] = off ? kiln_probe_grid_position(&r->set.grid, probe) : r->positions[probe];
    }
    return run_pass(r, &map, (size_t)((r->first + first) * r->elements), (size_t)(count * r->elements), r->samples,
                    r->stream, error);
}

/* Implements radiance_batch: gathers the radiance of probes in the present step. */
static int gather_batch(struct kiln_radiance *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    const int status = run_probes(r, first, count, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)r->params->threads) schedule(static)
    for (uint64_t i = 0; i < count; i++)
        kiln_probe_keep(&r->set.grid, r->element, r->results + i * r->elements,
                        r->data + (r->first + first + i) * r->set.grid.floats);
    return KILN_OK;
}

/* ---- places of probes ---- */

/* Returns a candidate place of a probe relative to its grid position, in spacings: 26 directions, first near, then
 * far. */
static struct kiln_vec3 candidate(uint32_t number)
{
    static const float reach[] = {0.25f, 0.45f};
    const uint32_t way = number % 26 < 13 ? number % 26 : number % 26 + 1; /* 13 is no way at all */
    const float far = reach[number / 26];
    return vec3(far * ((float)(way % 3) - 1.0f), far * ((float)(way / 3 % 3) - 1.0f), far * ((float)(way / 9) - 1.0f));
}

/* Moves a probe that is inside geometry. It goes to one of the nearest candidates that are not, the one with the fewest
 * backs; without any, it is switched off. `results`: its candidates' maps. */
static void move_probe(struct kiln_radiance *r, uint64_t probe, const struct kiln_probe_element *element,
                       const struct kiln_radiance_result *results)
{
    const struct kiln_vec3 from = kiln_probe_grid_position(&r->set.grid, probe);
    double least = MOST_BACKS;
    bool found = false;
    r->positions[probe] = vec3(KILN_PROBE_OFF, 0.0f, 0.0f);
    for (uint32_t i = 0; i < CANDIDATES; i++) {
        const double backs = kiln_probe_back_share(element, results + i * SEARCH_ELEMENTS, SEARCH_ELEMENTS);
        if (i == CANDIDATES / 2 && found)
            break;
        if (backs > least || (found && backs == least))
            continue;
        least = backs;
        found = true;
        r->positions[probe] = vec3_madd(from, candidate(i), r->set.grid.spacing);
    }
}

/* Moves the probes `inside[0 .. count)`, as many at once as fill a batch. All use the same random numbers, so the
 * grouping does not matter. */
static int move_probes(struct kiln_radiance *r, const uint64_t *inside, uint64_t count, struct kiln_error *error)
{
    enum { ITEMS = CANDIDATES * SEARCH_ELEMENTS, AT_ONCE = BATCH_ITEMS / ITEMS };
    const struct kiln_radiance_parameters map = {KILN_PROBE_OCTAHEDRAL, SEARCH_SIDE, ITEMS};
    const struct kiln_probe_grid grid = {.basis = KILN_PROBE_OCTAHEDRAL, .side = SEARCH_SIDE};
    struct kiln_probe_element search[SEARCH_ELEMENTS];
    int status = KILN_OK;
    kiln_probe_elements_make(&grid, search);
    for (uint64_t first = 0; first < count && status == KILN_OK; first += AT_ONCE) {
        const uint64_t some = count - first < AT_ONCE ? count - first : AT_ONCE;
        for (uint64_t i = 0; i < some * ITEMS; i++)
            r->places[i] = vec3_madd(kiln_probe_grid_position(&r->set.grid, inside[first + i / ITEMS]),
                                     candidate((uint32_t)(i % ITEMS) / SEARCH_ELEMENTS), r->set.grid.spacing);
        status = run_pass(r, &map, 0, (size_t)(some * ITEMS), 1, PLACING_STREAM + 1, error);
        for (uint64_t i = 0; i < some && status == KILN_OK; i++)
            move_probe(r, inside[first + i], search, r->results + i * ITEMS);
    }
    return status;
}

/* Implements radiance_batch: finds the places of this rank's probes [first, first + count). */
static int place_batch(struct kiln_radiance *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    uint64_t *inside = NULL, insides = 0;
    int status;
    KILN_TRY(kiln_allocate(&inside, count, sizeof *inside, "the radiance probes", error));
    for (uint64_t i = 0; i < count; i++)
        r->positions[r->first + first + i] = kiln_probe_grid_position(&r->set.grid, r->first + first + i);
    KILN_TRY(run_probes(r, first, count, error));
    for (uint64_t i = 0; i < count && !r->params->settings->faults.plain_probes; i++)
        if (kiln_probe_back_share(r->element, r->results + i * r->elements, r->elements) > MOST_BACKS)
            inside[insides++] = r->first + first + i;
    KILN_TRY(move_probes(r, inside, insides, error));
end:
    kiln_free(&inside);
    return status;
}

/* Implements radiance_batch: finds the probes that the points of this rank's tile runs see. */
static int sight_batch(struct kiln_radiance *r, uint64_t first, uint64_t count, struct kiln_error *error)
{
    const struct kiln_sight_params sight = {.backend = r->params->backend,
                                            .surface = r->params->surface,
                                            .probes = &r->set,
                                            .all = r->params->settings->faults.plain_probes,
                                            .threads = r->params->threads};
    return kiln_sight_find(&sight, (size_t)first, (size_t)(first + count), r->solution->own->surface.near_probes,
                           &r->rays, error);
}

/* Collective. What is known once the probes are placed; adds up over the ranks. */
static void report(struct kiln_radiance *r)
{
    const struct kiln_probe_grid *grid = &r->set.grid;
    const struct kiln_surface *surface = &r->solution->own->surface;
    uint64_t alone = 0;
    for (uint64_t i = 0; i < surface->count; i++)
        alone +=
            kiln_point_valid(surface, (struct kiln_own_point){i}) && (surface->near_probes[i] & KILN_PROBE_SEEN) == 0;
    (void)MPI_Allreduce(MPI_IN_PLACE, &alone, 1, MPI_UINT64_T, MPI_SUM, r->params->communicator);
    struct kiln_radiance_report *to = &r->solution->report.radiance;
    to->placed = true;
    to->moved = to->off = 0;
    to->alone = alone;
    for (uint64_t i = 0; i < r->probes; i++) {
        const struct kiln_vec3 off = vec3_sub(r->positions[i], kiln_probe_grid_position(grid, i));
        const bool is_off = kiln_probe_is_off(&r->set, (uint32_t)i);
        to->off += is_off;
        to->moved += !is_off && vec3_length(off) > 0.0f;
    }
}

/* Collective. */
static int place(struct kiln_radiance *r, struct kiln_error *error)
{
    r->stream = PLACING_STREAM;
    int status;
    KILN_TRY(run_all(r, place_batch, r->count, r->batch_probes, error));
    KILN_TRY(share(r, r->positions, sizeof *r->positions, error));
    KILN_TRY(run_all(r, sight_batch, r->params->surface->tile_run_count, BATCH_TILE_RUNS, error));
    report(r);
end:
    r->placed = status == KILN_OK;
    return status;
}

/* ---- a step ---- */

int kiln_radiance_update(struct kiln_radiance *r, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = r->params;
    struct kiln_step_report *step = kiln_solution_step(r->solution);
    const double start = MPI_Wtime();
    r->rays = 0;
    kiln_progress_phase(p->progress, "radiance probes", 0);
    int status =
        kiln_agree(p->communicator, kiln_backend_set_radiosity(p->backend, r->solution->radiosity, error), error);
    if (status == KILN_OK && !r->placed)
        status = place(r, error);
    r->stream = kiln_hash2(step->step.stream, step->step.part);
    KILN_TRY(status);
    KILN_TRY(run_all(r, gather_batch, r->count, r->batch_probes, error));
    KILN_TRY(share(r, r->data, r->set.grid.floats * sizeof *r->data, error));
    p->surface->near_probes = r->solution->own->surface.near_probes; /* which may have moved */
    KILN_TRY(kiln_agree(p->communicator, kiln_backend_set_probes(p->backend, &r->set, error), error));
end:
    step->probe_rays += r->rays;
    step->probe_seconds += MPI_Wtime() - start;
    return status;
}

void kiln_radiance_end(const struct kiln_radiance *r)
{
    const struct kiln_step_reports *steps = &r->solution->report.steps;
    uint64_t rays = 0;
    for (size_t i = 0; i < steps->count; i++)
        rays += steps->of[i].probe_rays;
    (void)MPI_Allreduce(MPI_IN_PLACE, &rays, 1, MPI_UINT64_T, MPI_SUM, r->params->communicator);
    r->solution->report.radiance.rays = rays;
}

/* ---- the companion ---- */

static bool probes_wanted(const struct kiln_integrate_params *params) { return params->settings->radiance != NULL; }

static int create(void **self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kiln_radiance *r = NULL;
    const int status = kiln_radiance_create(&r, site->params, site->solution, site->saved, error);
    *self = r;
    return status;
}

static void destroy(void **self)
{
    struct kiln_radiance *r = *self;
    kiln_radiance_destroy(&r);
    *self = NULL;
}

static int before_step(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    const struct kiln_step *step = &kiln_solution_step(site->solution)->step;
    return step->quantity == NULL && step->pass->reads_radiosity ? kiln_radiance_update(self, error) : KILN_OK;
}

static int end(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)site;
    (void)error;
    kiln_radiance_end(self);
    return KILN_OK;
}

static double beside(const struct kiln_step_report *report) { return report->probe_seconds; }

static const char *const identity[] = {"tracing-range",      "radiance-probe-spacing", "probe-basis", "probe-side",
                                       "distant-projection", "samples-radiance-probe", NULL};

const struct kiln_companion kiln_companion_probes = {.name = "probes",
                                                     .identity = identity,
                                                     .wanted = probes_wanted,
                                                     .create = create,
                                                     .destroy = destroy,
                                                     .before_step = before_step,
                                                     .end = end,
                                                     .phase = "radiance probes",
                                                     .beside = beside,
                                                     .report = {[KILN_REPORT_SETTINGS] = kiln_radiance_report_settings,
                                                                [KILN_REPORT_STEP] = kiln_radiance_report_step,
                                                                [KILN_REPORT_LIGHT] = kiln_radiance_report_light}};
