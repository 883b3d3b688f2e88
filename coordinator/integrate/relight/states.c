#include "coordinator/integrate/relight/states.h"

#include <math.h>
#include <string.h>

#include "coordinator/run/control.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/integrate/relight/states_private.h"
#include "coordinator/integrate/relight/transport.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"
#include "worker/pass/direct.h"
#include "worker/pass/gather.h"

enum { AT_ONCE = 64 };    /* tile runs whose answers are in memory at a time */
enum { PIECE = 1 << 20 }; /* bytes that a thread clears */

/* ---- making ---- */

/* Zeroes memory with all threads: a single one does not reach the memory's speed. */
static void clear(void *values, size_t bytes, uint32_t threads)
{
    const size_t pieces = (bytes + PIECE - 1) / PIECE;
#pragma omp parallel for schedule(static) num_threads((int)threads) if (pieces > 1)
    for (size_t i = 0; i < pieces; i++)
        memset((char *)values + i * PIECE, 0, i + 1 < pieces ? PIECE : bytes - i * PIECE);
}

static bool is_among(const void *const *pointers, const void *one)
{
    while (pointers != NULL && *pointers != NULL && *pointers != one)
        pointers++;
    return pointers != NULL && *pointers != NULL;
}

void kiln_state_clear_fields(struct kiln_state_slot *s, const void *const *but)
{
    const struct kiln_field_set *fields = s->params.fields;
    const struct kiln_rank_data *own = s->solution->own;
    for (size_t i = 0; i < fields->count && s->stale; i++) {
        const struct kiln_field *field = fields->entry[i].field;
        const bool lives = field->life == KILN_FIELD_RESULT || field->life == KILN_FIELD_STEP;
        void *values = lives && field->length == KILN_FIELD_EACH ? kiln_rank_field(own, fields, i) : NULL;
        const size_t count =
            field->domain == KILN_DOMAIN_POINT ? (size_t)own->surface.count : own->surface.tile_run_count;
        if (values != NULL && values != (void *)own->block && values != (void *)own->mixture && !is_among(but, values))
            clear(values, count * kiln_field_size(field), s->params.threads);
    }
    s->stale = false;
}

/* Collective. */
static int make_solution(struct kiln_state_slot *s, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = &s->params;
    const struct kiln_radiosity_allgather_params params = {.communicator = p->communicator,
                                                           .node = p->node,
                                                           .total = p->surface->point_count,
                                                           .first = p->surface->first,
                                                           .count = p->surface->count,
                                                           .threads = p->threads,
                                                           .limit = p->settings->exchange_limit};
    int status = kiln_radiosity_allgather_create(&s->solution->allgather, &params, error);
    if (status != KILN_OK)
        return status;
    s->solution->radiosity = kiln_radiosity_allgather_values(s->solution->allgather);
    status = kiln_node_data_create(&s->solution->node_data, p->node, p->surface, p->fields, false, error);
    if (status == KILN_OK) {
        kiln_node_data_set_radiosity(s->solution->node_data, s->solution->radiosity);
        kiln_solution_refresh(s->solution);
        status = kiln_companions_find(s->params.companions, &s->params, s->solution->own, error);
    }
    return kiln_agree(p->communicator, status, error);
}

/* Collective. */
static int make_slot(const struct kiln_states *states, struct kiln_state_slot *s, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = states->params;
    s->params = *p;
    int status = kiln_allocate(&s->solution, 1, sizeof *s->solution, "a state", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->results, (size_t)AT_ONCE * KILN_TILE_TEXELS, sizeof *s->results, "a state", error);
    status = kiln_agree(p->communicator, status, error);
    s->taker = (struct kiln_taker){.ledger = &s->ledger, .threads = p->threads};
    s->exchange = (struct kiln_radiosity_exchange){s->solution, p->control, NULL, p->threads};
    if (status == KILN_OK)
        status = make_solution(s, error);
    s->stale = status == KILN_OK;
    if (s->stale) /* their memory is touched for the first time, by all threads */
        kiln_state_clear_fields(s, NULL);
    return status;
}

int kiln_states_create(struct kiln_states **states, const struct kiln_integrate_params *params,
                       struct kiln_resident *resident, size_t width, struct kiln_error *error)
{
    struct kiln_states *st = NULL;
    const uint32_t groups = (uint32_t)((width + KILN_RESIDENT_LANES - 1) / KILN_RESIDENT_LANES),
                   lanes = width > 1 ? groups * KILN_RESIDENT_LANES : 1;
    int status;
    KILN_TRY(kiln_allocate(&st, 1, sizeof *st, "the states", error));
    st->params = params;
    st->resident = resident;
    st->may_hold = true;
    KILN_TRY(kiln_allocate(&st->slots, width, sizeof *st->slots, "the states", error));
    KILN_TRY(kiln_allocate(&st->wanted, params->surface->tile_run_count, 1, "the states", error));
    KILN_TRY(kiln_allocate(&st->light, (size_t)kiln_resident_floats(params->surface->point_count, lanes),
                           sizeof *st->light, "the radiosity of states", error));
end:
    *states = st;
    status = kiln_agree(params->communicator, status, error);
    for (size_t i = 0; i < width && status == KILN_OK; i++) {
        st->width = i + 1;
        status = make_slot(st, &st->slots[i], error);
    }
    if (status != KILN_OK)
        kiln_states_destroy(states);
    return status;
}

void kiln_states_destroy(struct kiln_states **states)
{
    struct kiln_states *st = *states;
    if (st == NULL)
        return;
    for (size_t i = 0; i < st->width; i++) {
        kiln_ledger_release(&st->slots[i].ledger);
        kiln_taker_release(&st->slots[i].taker);
        kiln_solution_destroy(&st->slots[i].solution);
        kiln_free(&st->slots[i].results);
    }
    kiln_free(&st->slots);
    kiln_free(&st->wanted);
    kiln_free(&st->light);
    kiln_free(states);
}

struct kiln_solution *kiln_states_solution(const struct kiln_states *states, size_t state)
{
    return states->slots[state].solution;
}

/* ---- the begin and the end of a state ---- */

static void set_albedo(const struct kiln_state_slot *s, const uint16_t *albedo)
{
    struct kiln_rank_data *own = (struct kiln_rank_data *)(uintptr_t)s->solution->own;
    own->surface.albedo = (uint16_t *)(uintptr_t)albedo;
}

static int begin_state(struct kiln_state_slot *s, const struct kiln_state *state, struct kiln_error *error)
{
    struct kiln_step_reports steps = s->solution->report.steps;
    steps.count = 0;
    s->state = *state;
    s->params.settings = state->settings;
    s->params.emission = state->emission;
    s->solution->report = (struct kiln_integrate_report){.roles = kiln_roles(state->settings), .steps = steps};
    s->integration = (struct kiln_integration){.communicator = s->params.communicator,
                                               .settings = state->settings,
                                               .solution = s->solution,
                                               .ledger = &s->ledger,
                                               .exchange = &s->exchange};
    s->mixed = false;
    s->stale = true;
    set_albedo(s, state->albedo);
    kiln_ledger_release(&s->ledger);
    const int status =
        kiln_ledger_create(&s->ledger, s->params.surface, kiln_luminance(state->emission->emitted), error);
    const double area = s->params.area > 0.0 ? s->params.area : 1.0;
    if (status == KILN_OK) /* as for any bake: integrate.c */
        kiln_radiosity_allgather_set_scale(s->solution->allgather,
                                           ldexp(1.0, ilogb(kiln_ledger_power(&s->ledger) / area)));
    return status;
}

/* Collective. */
static void end_state(struct kiln_state_slot *s)
{
    struct kiln_integrate_report *report = &s->solution->report;
    kiln_radiosity_allgather_abandon(s->solution->allgather);
    if (s->state.settings->probes)
        kiln_exchange_total_radiosity(&s->exchange, kiln_solution_step(s->solution));
    kiln_energy_close(&report->energy, &report->steps, s->state.emission,
                      &(struct kiln_energy_closing){.caustics = KILN_CAUSTICS_NONE, .albedo_scale = 1.0});
}

/* ---- a step ---- */

/* Collective. Begins the next step: exchanges the light that it gathers from. */
static int begin_step(struct kiln_state_slot *s, struct kiln_error *error)
{
    struct kiln_step_reports *steps = &s->solution->report.steps;
    struct kiln_step_report *last = steps->count > 0 ? kiln_solution_step(s->solution) : NULL;
    int status = KILN_OK;
    kiln_state_clear_fields(s, NULL);
    if (s->step.quantity == NULL)
        status = s->state.settings->integrator->begin_step(&s->integration, last, &s->step, error);
    else if (s->step.pass->reads_radiosity)
        kiln_exchange_total_radiosity(&s->exchange, last);
    if (status == KILN_OK)
        status = kiln_agree(s->params.communicator, kiln_step_reports_reserve(steps, steps->count + 1, error), error);
    if (status != KILN_OK)
        return status;
    steps->of[steps->count++] = (struct kiln_step_report){.step = s->step};
    kiln_ledger_begin_step(&s->ledger);
    s->taker.taking = (struct kiln_taking){.settings = s->state.settings,
                                           .step = &kiln_solution_step(s->solution)->step,
                                           .fields = s->params.fields,
                                           .scene = s->params.backend->params.scene,
                                           .radiosity = s->solution->radiosity,
                                           .scale = kiln_radiosity_allgather_scale(s->solution->allgather),
                                           .unit = s->ledger.unit};
    kiln_radiosity_allgather_begin(s->solution->allgather);
    return KILN_OK;
}

/* Collective. Adds up over the ranks. `here`: the step's answers are the host's. */
static int end_step(struct kiln_state_slot *s, bool here, struct kiln_error *error)
{
    struct kiln_integrate_report *r = &s->solution->report;
    struct kiln_step_report *report = kiln_solution_step(s->solution);
    if (report->step.early && here)
        kiln_radiosity_allgather_advance(s->solution->allgather, kiln_next_compact(s->solution->own),
                                         s->solution->own->surface.count);
    int status;
    KILN_TRY(kiln_ledger_end_step(&s->ledger, s->params.communicator, &report->energy, error));
    if (report->step.quantity == NULL)
        KILN_TRY(s->state.settings->integrator->end_step(&s->integration, &r->steps, error));
    if (report->step.quantity == NULL)
        KILN_TRY(kiln_part_end(&s->params, s->solution, s->ledger.unit, error));
end:
    return status;
}

/* Returns the samples of each of this rank's tile runs in the step; NULL: the same for all. */
static const uint32_t *samples_of(const struct kiln_state_slot *s)
{
    const char *name = s->step.samples_field;
    return name == NULL
               ? NULL
               : kiln_rank_field(s->solution->own, s->params.fields, kiln_field_set_find(s->params.fields, name));
}

/* ---- by the backend ---- */

/* Implements kiln_take_results; `context` is the slot. */
static int take_traced(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct kiln_state_slot *s = context;
    if (s->step.pass == &kiln_pass_direct && s->state.direct.see != NULL)
        s->state.direct.see(s->state.direct.context, &s->step, first, count, results);
    return kiln_taker_take(&s->taker, s->solution->own, first, count, NULL, results, error);
}

/* All own points of a step, traced. */
static int trace(struct kiln_state_slot *s, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = &s->params;
    struct kiln_step_report *report = kiln_solution_step(s->solution);
    struct kiln_batches batches = {.params = p, .report = report};
    struct kiln_batch batch = {.count = s->solution->own->surface.tile_run_count,
                               .stream = s->step.stream,
                               .samples = s->step.samples,
                               .first_sample = s->step.first_sample,
                               .samples_each = samples_of(s),
                               .take = take_traced,
                               .context = s};
    int status =
        s->step.pass->reads_radiosity ? kiln_backend_set_radiosity(p->backend, s->solution->radiosity, error) : KILN_OK;
    const double start = MPI_Wtime();
    if (status == KILN_OK)
        status = kiln_batches_choose(&batches, s->solution->own, &batch, error);
    if (status == KILN_OK && batch.count > 0)
        status = kiln_backend_run(p->backend, s->step.pass, s->step.parameters, &batch, &report->rays, error);
    report->seconds += MPI_Wtime() - start;
    kiln_batches_release(&batches);
    if (status == KILN_OK && s->step.pass == &kiln_pass_direct && s->state.direct.end != NULL)
        s->state.direct.end(s->state.direct.context, s->solution->own);
    return status;
}

/* ---- direct light supplied by the caller ---- */

static int give_direct(struct kiln_state_slot *s, struct kiln_error *error)
{
    const struct kiln_rank_data *own = s->solution->own;
    return kiln_taker_take_given(&s->taker, own, 0, own->surface.tile_run_count, s->state.direct.give,
                                 s->state.direct.context, error);
}

/* ---- gathers ---- */

static bool gathers(const struct kiln_state_slot *s) { return kiln_transport_keeps(&s->step); }

/* Whether two states gather by the same rays. */
static bool gather_alike(const struct kiln_state_slot *a, const struct kiln_state_slot *b)
{
    const struct kiln_step *x = &a->step, *y = &b->step;
    return gathers(a) && gathers(b) && x->stream == y->stream && x->samples == y->samples &&
           x->first_sample == y->first_sample && x->part == y->part && x->bounce == y->bounce && x->with == y->with;
}

static bool wants(const struct kiln_state_slot *s, size_t tile_run)
{
    const uint32_t *samples = samples_of(s);
    return samples == NULL || samples[tile_run] > 0;
}

/* States that gather together, in groups of KILN_RESIDENT_LANES. The light of the groups is stored one after the
 * other. */
struct flock {
    struct kiln_state_slot *of[KILN_STATES_MOST];
    size_t count;
    const struct kiln_resident_rows *rows;
};

static uint32_t lanes_of(const struct flock *flock, size_t state)
{
    return kiln_resident_lanes(flock->count - state / KILN_RESIDENT_LANES * KILN_RESIDENT_LANES);
}

/* The light of the group that a state is in. */
static float *light_of(const struct kiln_states *st, size_t state)
{
    const uint64_t points = st->params->surface->point_count;
    return st->light + state / KILN_RESIDENT_LANES * kiln_resident_floats(points, KILN_RESIDENT_LANES);
}

static void lay_light(const struct kiln_states *st, const struct flock *flock)
{
#pragma omp parallel for schedule(dynamic, 1) num_threads((int)st->params->threads)
    for (size_t i = 0; i < flock->count; i++)
        kiln_resident_light(flock->of[i]->solution->radiosity, st->params->surface->point_count,
                            (uint32_t)(i % KILN_RESIDENT_LANES), lanes_of(flock, i), light_of(st, i));
}

/* Computes the answers of one tile run, and stores them at its place in the block that begins with tile run `begin`. */
static void gather_run(const struct kiln_states *st, const struct flock *flock, size_t begin, size_t tile_run)
{
    const struct kiln_surface *surface = &flock->of[0]->solution->own->surface;
    const struct kiln_tile_run *run = &surface->tile_runs[tile_run];
    const uint64_t at = run->first.at - surface->tile_runs[begin].first.at;
    if (st->wanted[tile_run] == 0)
        return;
    for (size_t first = 0; first < flock->count; first += KILN_RESIDENT_LANES) {
        struct kiln_point_result *results[KILN_RESIDENT_LANES] = {NULL};
        for (size_t i = first; i < flock->count && i < first + KILN_RESIDENT_LANES; i++)
            results[i - first] = flock->of[i]->results + at;
        kiln_resident_gather(flock->rows, run, tile_run, light_of(st, first), surface->point_count,
                             lanes_of(flock, first), results);
    }
}

/* Gives a state the answers of tile runs, except those that the state leaves out. */
static int take_block(struct kiln_state_slot *s, const struct kiln_point_result *results, size_t begin, size_t end,
                      struct kiln_error *error)
{
    const struct kiln_tile_run *runs = s->solution->own->surface.tile_runs;
    int status = KILN_OK;
    for (size_t f = begin, next; f < end && status == KILN_OK; f = next) {
        for (next = f + 1; next < end && wants(s, next) == wants(s, f); next++)
            ;
        if (wants(s, f))
            status = kiln_taker_take(&s->taker, s->solution->own, f, next - f, NULL,
                                     results + (runs[f].first.at - runs[begin].first.at), error);
    }
    return status;
}

/* ---- gathers by a device that keeps the rows ---- */

/* States whose answers are adjacent in memory. */
struct shared {
    struct kiln_state_slot *const *of;
    size_t count;
};

/* Implements kiln_take_results; `context` is a struct shared. */
static int take_shared(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    const struct shared *shared = context;
    const struct kiln_tile_run *runs = shared->of[0]->solution->own->surface.tile_runs;
    const struct kiln_point_result *from = results;
    int status = KILN_OK;
    if (shared->count == 1)
        return take_block(shared->of[0], from, first, first + count, error);
    for (size_t begin = first, end; begin < first + count && status == KILN_OK; begin = end) {
        end = first + count - begin < AT_ONCE ? first + count : begin + AT_ONCE;
        const size_t points = (size_t)kiln_tile_runs_points(&runs[begin], &runs[end - 1]);
        for (size_t i = 0; i < shared->count && status == KILN_OK; i++) {
            struct kiln_state_slot *s = shared->of[i];
            for (size_t k = 0; k < points; k++)
                s->results[k] = from[k * shared->count + i];
            status = take_block(s, s->results, begin, end, error);
        }
        from += points * shared->count;
    }
    return status;
}

/* Replays the rows of consecutive tile runs that some state wants. */
static int replay_stretch(const struct kiln_states *st, const struct flock *flock, size_t first, size_t count,
                          struct kiln_error *error)
{
    const struct kiln_step *step = &flock->of[0]->step;
    struct kiln_step_report report = {.step = *step};
    struct kiln_batches batches = {.params = st->params, .report = &report};
    struct kiln_batch batch = {.first = first,
                               .count = count,
                               .stream = step->stream,
                               .samples = step->samples,
                               .first_sample = step->first_sample,
                               .take = take_shared};
    struct kiln_backend *backend = st->params->backend;
    struct kiln_rows *rows = kiln_resident_for_backend(st->resident, flock->rows);
    int status = kiln_batches_choose(&batches, flock->of[0]->solution->own, &batch, error);
    const size_t at_once = kiln_batch_has_few(&batch) ? 1 : KILN_ROW_LIGHTS;
    for (size_t i = 0; i < flock->count && status == KILN_OK; i += at_once) {
        const uint64_t *lights[KILN_ROW_LIGHTS];
        uint64_t rays = 0;
        struct shared shared = {flock->of + i, flock->count - i < at_once ? flock->count - i : at_once};
        batch.context = &shared;
        for (size_t l = 0; l < shared.count; l++)
            lights[l] = shared.of[l]->solution->radiosity;
        if (!kiln_batch_has_few(&batch)) {
            status = kiln_backend_replay(backend, rows, lights, shared.count, &batch, error);
            continue;
        }
        status = kiln_backend_set_radiosity(backend, lights[0], error);
        kiln_backend_set_rows(backend, rows);
        if (status == KILN_OK)
            status = kiln_backend_run(backend, step->pass, NULL, &batch, &rays, error);
        kiln_backend_set_rows(backend, NULL);
    }
    kiln_batches_release(&batches);
    return status;
}

static int replay(const struct kiln_states *st, const struct flock *flock, struct kiln_error *error)
{
    const size_t runs = st->params->surface->tile_run_count;
    int status = KILN_OK;
    for (size_t f = 0, next; f < runs && status == KILN_OK; f = next) {
        for (next = f + 1; next < runs && st->wanted[next] == st->wanted[f];)
            next++;
        if (st->wanted[f] != 0)
            status = replay_stretch(st, flock, f, next - f, error);
    }
    return status;
}

/* ---- any gather ---- */

static int gather(struct kiln_states *st, struct flock *flock, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = st->params;
    const size_t runs = p->surface->tile_run_count;
    for (size_t f = 0; f < runs; f++) {
        st->wanted[f] = 0;
        for (size_t i = 0; i < flock->count; i++)
            st->wanted[f] |= wants(flock->of[i], f);
    }
    int status =
        kiln_resident_step(st->resident, flock->of[0]->solution, &flock->of[0]->step, st->wanted, &flock->rows, error);
    KILN_TRY(status);
    if (kiln_backend_replays(p->backend))
        return replay(st, flock, error);
    lay_light(st, flock);
    for (size_t begin = 0; begin < runs; begin += AT_ONCE) {
        const size_t end = runs - begin < AT_ONCE ? runs : begin + AT_ONCE;
#pragma omp parallel for schedule(dynamic, 4) num_threads((int)p->threads)
        for (size_t f = begin; f < end; f++)
            gather_run(st, flock, begin, f);
        for (size_t i = 0; i < flock->count; i++)
            KILN_TRY(take_block(flock->of[i], flock->of[i]->results, begin, end, error));
    }
end:
    return status;
}

/* ---- all states ---- */

/* Runs one step of a state, together with all later states that gather with the same rays. `done`: states that have had
 * their step. */
static int run_step(struct kiln_states *st, size_t first, bool done[KILN_STATES_MOST], struct kiln_error *error)
{
    struct kiln_state_slot *s = &st->slots[first];
    struct flock flock = {.of = {s}, .count = 1};
    done[first] = true;
    if (!gathers(s))
        return s->step.pass == &kiln_pass_direct && s->step.quantity == NULL && s->state.direct.give != NULL
                   ? give_direct(s, error)
                   : trace(s, error);
    for (size_t i = first + 1; i < st->active; i++)
        if (st->slots[i].goes_on && !done[i] && gather_alike(s, &st->slots[i])) {
            flock.of[flock.count++] = &st->slots[i];
            done[i] = true;
        }
    return gather(st, &flock, error);
}

bool kiln_state_mixes(const struct kiln_state_slot *s)
{
    return s->has_next && s->step.pass == &kiln_pass_direct && s->step.quantity == NULL && s->state.direct.mixed;
}

/* Order in which steps run. OTHER: all steps except gathers and direct light that a device mixes. */
enum { OTHER, MIX, GATHER, NO_STEP };

static int order_of(const struct kiln_state_slot *s)
{
    return !s->has_next ? NO_STEP : gathers(s) ? GATHER : kiln_state_mixes(s) ? MIX : OTHER;
}

/* Chooses the states' next steps. States that gather wait for those that do not, so that they gather together. States
 * whose direct light a device may mix wait for those whose direct light it may not, so that the device gets the light
 * of all. */
static bool find_steps(const struct kiln_states *st)
{
    int first = NO_STEP;
    for (size_t i = 0; i < st->active; i++) {
        struct kiln_state_slot *s = &st->slots[i];
        const struct kiln_step_reports *steps = &s->solution->report.steps;
        s->has_next = kiln_steps_next(s->state.settings, steps->of, steps->count, &s->step);
        first = order_of(s) < first ? order_of(s) : first;
    }
    for (size_t i = 0; i < st->active; i++)
        st->slots[i].goes_on = order_of(&st->slots[i]) == first && first != NO_STEP;
    return first != NO_STEP;
}

static int run_here(struct kiln_states *st, struct kiln_error *error)
{
    bool done[KILN_STATES_MOST] = {false};
    int status = KILN_OK;
    for (size_t i = 0; i < st->active && status == KILN_OK; i++)
        if (st->slots[i].goes_on)
            status = begin_step(&st->slots[i], error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < st->active && status == KILN_OK; i++)
        if (st->slots[i].goes_on && !done[i])
            status = run_step(st, i, done, error);
    return kiln_agree(st->params->communicator, status, error);
}

/* Collective. Runs the next step of each state that has one and does not wait for another state. */
static int run_round(struct kiln_states *st, bool *any, struct kiln_error *error)
{
    bool held = false;
    *any = find_steps(st);
    int status;
    KILN_TRY(kiln_states_hold(st, &held, error));
    KILN_TRY(held ? kiln_states_run_held(st, error) : run_here(st, error));
    for (size_t i = 0; i < st->active; i++)
        if (st->slots[i].goes_on)
            KILN_TRY(end_step(&st->slots[i], !held, error));
end:
    return status;
}

static int solve(struct kiln_states *st, const struct kiln_state *of, struct kiln_error *error)
{
    int status = KILN_OK;
    st->holds = false;
    for (size_t i = 0; i < st->active && status == KILN_OK; i++)
        status = begin_state(&st->slots[i], &of[i], error);
    status = kiln_agree(st->params->communicator, status, error);
    for (bool any = true; any && status == KILN_OK;) {
        if (kiln_stop_asked(kiln_control_stop(st->params->control)))
            status = kiln_give_up(error);
        status = kiln_agree(st->params->communicator, status, error);
        if (status == KILN_OK)
            status = run_round(st, &any, error);
    }
    return status;
}

int kiln_states_solve(struct kiln_states *st, const struct kiln_state *of, size_t count, struct kiln_error *error)
{
    st->active = count;
    int status = solve(st, of, error);
    if (status == KILN_NO_DEVICE && st->holds) { /* the device has lost the data that it held: start again without it */
        st->may_hold = false;
        status = solve(st, of, error);
    }
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        end_state(&st->slots[i]);
    return status;
}
