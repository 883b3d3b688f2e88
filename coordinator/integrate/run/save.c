#include <assert.h>
#include <math.h>
#include <string.h>
#include <time.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/field/field_blocks.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/integrate/run/save.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

#define WRITE_BYTES 20e6 /* bytes per second of the slowest disk that is not taken for dead */

/* most steps: with the largest number of bounces, in parts, or in rounds with sixteen steps per bounce */
enum { STEPS_MOST = 16 * 10002 };
/* blocks besides fields: those listed here, and those of kiln_integrate_save */
enum { OTHER_BLOCKS = 12 + KILN_COMPANY_ARRAYS };
static_assert((int)KILN_FIELDS_MAX + (int)OTHER_BLOCKS <= (int)KILN_ARRAYS_MAX, "a checkpoint has room for all fields");

/* ---- records ----
 *
 * Contents of a checkpoint besides the fields. Members have fixed widths and leave no gaps, and the structs are used
 * for nothing else. A change of any of them requires a larger KILN_CHECKPOINT_FORMAT (checkpoint_private.h). */

/* The array "state", once: where the bake stands. */
struct saved_state {
    uint32_t finished, bounces, tail, restarts;
    double tail_ratio[3], tail_share, tail_sum_error, tail_object_error, tail_tile_error;
    double unit, unit_squared, seconds;
    double merge_radius;
    uint64_t tail_pocket;
};
static_assert(sizeof(struct saved_state) == 4 * 4 + 12 * 8, "a record has no gaps");

enum { CAUSTICS = 16 };

/* The block "steps", an element per step: the part of its report that all ranks share. */
struct saved_report {
    uint32_t role, bounce, samples;
    uint32_t judged, moved;   /* of the balance: 0 or 1 */
    uint32_t out_of_time;     /* 0 or 1 */
    uint32_t from, to;        /* of the next round; from bit CAUSTICS on: of its caustics */
    uint32_t tried, left_out; /* of caustics: 0 or 1 */
    double incident[3], reflected[3], sent[3], escaped[3], blocked[3], glass[3], gloss[3], unfound[3], variance;
    double tail_error, object_error, unfinished, share, imbalance, gain, cost, brings, rest;
    uint64_t points;
};
static_assert(sizeof(struct saved_report) == 10 * 4 + 35 * 8, "a record has no gaps");

/* The block "own_steps" of each rank, an element per step: that rank's part of its report. */
struct saved_own_step {
    uint64_t rays;
    double seconds, exchange_seconds, device_seconds;
    uint64_t probe_rays;
    double probe_seconds;
};
static_assert(sizeof(struct saved_own_step) == 6 * 8, "a record has no gaps");

/* A sum in 128 bits. */
struct saved_sum {
    uint64_t low;
    int64_t high;
};

/* The array "own_groups" of each rank: the power of each group of tiles that has some. */
struct saved_group {
    uint64_t index;
    struct saved_sum sum;
};
static_assert(sizeof(struct saved_group) == 3 * 8, "a record has no gaps");

/* The array "done" of each rank: ranges of points whose answers are in the fields. */
struct saved_range {
    uint64_t first, count;
};

/* The array "own_sums" of each rank, once: its sums in the step under way. */
struct saved_sums {
    struct saved_sum sums[KILN_SUMS], variance;
};
static_assert(sizeof(struct saved_sums) == (KILN_SUMS + 1) * 16, "a record has no gaps");

static struct saved_sum sum_saved(const struct kiln_exact_sum *sum)
{
    return (struct saved_sum){(uint64_t)sum->value, (int64_t)(sum->value >> 64)};
}

static __int128 sum_read(const struct saved_sum *sum)
{
    return (__int128)sum->high * ((__int128)1 << 64) + (__int128)sum->low;
}

static struct saved_report report_saved(const struct kiln_step_report *r)
{
    const struct kiln_step_energy *e = &r->energy;
    struct saved_report saved = {.role = r->step.role,
                                 .bounce = r->step.bounce,
                                 .samples = r->step.samples,
                                 .tail_error = r->tail_error,
                                 .object_error = r->object_error,
                                 .unfinished = r->unfinished,
                                 .out_of_time = r->out_of_time,
                                 .from = r->round.from | r->round.caustics_from << CAUSTICS,
                                 .to = r->round.to | r->round.caustics_to << CAUSTICS,
                                 .share = r->round.share,
                                 .tried = r->caustics.tried,
                                 .left_out = r->caustics.left_out,
                                 .brings = r->caustics.brings,
                                 .rest = r->caustics.rest,
                                 .judged = r->balance.judged,
                                 .moved = r->balance.moved,
                                 .variance = e->variance,
                                 .imbalance = r->balance.imbalance,
                                 .gain = r->balance.gain,
                                 .cost = r->balance.cost,
                                 .points = r->balance.points};
    for (int c = 0; c < 3; c++) {
        saved.incident[c] = e->incident[c];
        saved.reflected[c] = e->reflected[c];
        saved.sent[c] = e->sent[c];
        saved.escaped[c] = e->escaped[c];
        saved.blocked[c] = e->blocked[c];
        saved.glass[c] = e->glass[c];
        saved.gloss[c] = e->gloss[c];
        saved.unfound[c] = e->unfound[c];
    }
    return saved;
}

static struct kiln_round round_read(const struct saved_report *saved)
{
    const uint32_t levels = (1u << CAUSTICS) - 1;
    return (struct kiln_round){.from = saved->from & levels,
                               .to = saved->to & levels,
                               .share = saved->share,
                               .caustics_from = saved->from >> CAUSTICS,
                               .caustics_to = saved->to >> CAUSTICS};
}

/* Reads a report without the ranks' own parts: see add_part. */
static struct kiln_step_report report_read(const struct saved_report *saved)
{
    struct kiln_step_report r = {.step = {.role = saved->role, .bounce = saved->bounce, .samples = saved->samples},
                                 .tail_error = saved->tail_error,
                                 .object_error = saved->object_error,
                                 .unfinished = saved->unfinished,
                                 .out_of_time = saved->out_of_time != 0,
                                 .round = round_read(saved),
                                 .caustics = {saved->tried != 0, saved->left_out != 0, saved->brings, saved->rest},
                                 .energy = {.variance = saved->variance},
                                 .balance = {.judged = saved->judged != 0,
                                             .moved = saved->moved != 0,
                                             .imbalance = saved->imbalance,
                                             .gain = saved->gain,
                                             .cost = saved->cost,
                                             .points = saved->points}};
    for (int c = 0; c < 3; c++) {
        r.energy.incident[c] = saved->incident[c];
        r.energy.reflected[c] = saved->reflected[c];
        r.energy.sent[c] = saved->sent[c];
        r.energy.escaped[c] = saved->escaped[c];
        r.energy.blocked[c] = saved->blocked[c];
        r.energy.glass[c] = saved->glass[c];
        r.energy.gloss[c] = saved->gloss[c];
        r.energy.unfound[c] = saved->unfound[c];
    }
    return r;
}

static const struct kiln_field_set *fields_of(const struct kiln_saved *s)
{
    return kiln_node_data_fields(s->solution->node_data);
}

/* Collective. Counts the tile runs of the ranks before this one. */
static uint64_t count_before(const struct kiln_saved *s)
{
    const uint64_t own = s->solution->own->surface.tile_run_count;
    uint64_t before = 0;
    (void)MPI_Exscan(&own, &before, 1, MPI_UINT64_T, MPI_SUM, s->params->communicator);
    return s->params->rank > 0 ? before : 0;
}

static struct kiln_save_moment moment_of(const struct kiln_saved *s, uint64_t tile_run_first, bool finished)
{
    const struct kiln_step *step = &kiln_solution_step(s->solution)->step;
    return (struct kiln_save_moment){.in_step = !finished,
                                     .in_gather = step->pass->reads_radiosity,
                                     .compact = step->compact,
                                     .tile_run_first = tile_run_first};
}

uint64_t kiln_save_bytes(const struct kiln_saved *s)
{
    return s->params->surface->point_count *
           (kiln_field_set_saved_bytes(fields_of(s)) +
            kiln_company_saved_bytes(s->company, &kiln_solution_step(s->solution)->step));
}

/* ---- writing ---- */

/* Data made for a checkpoint. */
struct save_work {
    struct saved_state state;
    struct saved_sums sums;
    struct saved_report *reports;
    struct saved_own_step *own_steps;
    struct saved_group *groups;
    struct saved_range *done;
    size_t group_count, done_count;
    struct kiln_array_range blocks[KILN_ARRAYS_MAX];
    size_t array_count;
    struct kiln_arena arena;
};

static void add_array(struct save_work *w, const char *name, uint64_t first, uint64_t count, size_t size,
                      const void *data)
{
    struct kiln_array_range *b = &w->blocks[w->array_count++];
    *b = (struct kiln_array_range){.first = first, .count = count, .size = size, .data = data};
    (void)strncpy(b->name, name, sizeof b->name - 1);
}

static int collect_groups(const struct kiln_saved *s, struct save_work *w, struct kiln_error *error)
{
    size_t count = 0;
    for (size_t i = 0; i < s->ledger->group_count; i++)
        count += s->ledger->group_now[i].value != 0;
    const int status =
        kiln_arena_allocate(&w->arena, &w->groups, count, sizeof *w->groups, "a checkpoint's groups", error);
    for (size_t i = 0; status == KILN_OK && i < s->ledger->group_count; i++)
        if (s->ledger->group_now[i].value != 0)
            w->groups[w->group_count++] = (struct saved_group){i, sum_saved(&s->ledger->group_now[i])};
    return status;
}

static size_t count_lacking(const struct kiln_rank_data *own)
{
    size_t count = 0;
    for (size_t f = 0; own->lacking != NULL && f < own->surface.tile_run_count; f++)
        count += own->lacking[f];
    return count;
}

/* Adds the points of the tile runs [first, end), except those to be computed again. */
static void add_done(const struct kiln_rank_data *own, struct save_work *w, size_t first, size_t end)
{
    const struct kiln_tile_run *runs = own->surface.tile_runs;
    for (size_t f = first, next; f < end; f = next + 1) {
        for (next = f; next < end && (own->lacking == NULL || own->lacking[next] == 0);)
            next++;
        if (next > f)
            w->done[w->done_count++] =
                (struct saved_range){runs[f].first.at, kiln_tile_runs_points(&runs[f], &runs[next - 1])};
    }
}

/* Lists the finished ranges: everything between the tile runs still to do. */
static int collect_done(const struct kiln_saved *s, struct save_work *w, struct kiln_error *error)
{
    const struct kiln_rank_data *own = s->solution->own;
    const int status =
        kiln_arena_allocate(&w->arena, &w->done, s->work->todo_count - s->work->todo_first + count_lacking(own) + 1,
                            sizeof *w->done, "a checkpoint's ranges", error);
    size_t at = 0;
    for (size_t i = s->work->todo_first; status == KILN_OK && i < s->work->todo_count; i++) {
        add_done(own, w, at, s->work->todo[i].first);
        at = s->work->todo[i].first + s->work->todo[i].count;
    }
    if (status == KILN_OK)
        add_done(own, w, at, own->surface.tile_run_count);
    return status;
}

static int collect_steps(const struct kiln_saved *s, struct save_work *w, struct kiln_error *error)
{
    const struct kiln_integrate_report *r = &s->solution->report;
    int status;
    KILN_TRY(kiln_arena_allocate(&w->arena, &w->own_steps, r->steps.count, sizeof *w->own_steps, "a checkpoint's steps",
                                 error));
    KILN_TRY(
        kiln_arena_allocate(&w->arena, &w->reports, r->steps.count, sizeof *w->reports, "a checkpoint's steps", error));
    for (size_t i = 0; i < r->steps.count; i++) {
        const struct kiln_step_report *p = &r->steps.of[i];
        w->own_steps[i] = (struct saved_own_step){p->rays,           p->seconds,    p->exchange_seconds,
                                                  p->device_seconds, p->probe_rays, p->probe_seconds};
        w->reports[i] = report_saved(p);
    }
end:
    return status;
}

static struct saved_state state_of(const struct kiln_saved *s, bool finished)
{
    const struct kiln_integrate_report *r = &s->solution->report;
    struct saved_state state = {.finished = finished,
                                .bounces = r->bounces,
                                .tail = r->tail,
                                .restarts = r->restarts,
                                .tail_share = r->tail_share,
                                .tail_sum_error = r->tail_error,
                                .tail_object_error = r->tail_object_error,
                                .tail_tile_error = r->tail_tile_error,
                                .tail_pocket = r->tail_pocket,
                                .unit = s->ledger->unit,
                                .unit_squared = s->ledger->unit_squared,
                                .merge_radius = r->landing.radius,
                                .seconds = r->seconds_before + MPI_Wtime() - s->params->begin};
    memcpy(state.tail_ratio, r->tail_ratio, sizeof state.tail_ratio);
    return state;
}

/* Collective. */
static void list_blocks(const struct kiln_saved *s, struct save_work *w, bool finished)
{
    const struct kiln_integrate_report *r = &s->solution->report;
    const struct kiln_save_moment moment = moment_of(s, count_before(s), finished);
    if (s->params->rank == 0) {
        add_array(w, "state", 0, 1, sizeof w->state, &w->state);
        add_array(w, "steps", 0, r->steps.count, sizeof *w->reports, w->reports);
    }
    if (s->params->rank == 0 && !finished) {
        add_array(w, "group_before", 0, s->ledger->group_count, sizeof *s->ledger->group_before,
                  s->ledger->group_before);
        add_array(w, "group_total", 0, s->ledger->group_count, sizeof *s->ledger->group_total, s->ledger->group_total);
    }
    add_array(w, "own_steps", 0, r->steps.count, sizeof *w->own_steps, w->own_steps);
    w->array_count += kiln_field_arrays(fields_of(s), s->solution->own, &moment, w->blocks + w->array_count);
    if (finished)
        return;
    add_array(w, "done", 0, w->done_count, sizeof *w->done, w->done);
    add_array(w, "own_sums", 0, 1, sizeof w->sums, &w->sums);
    add_array(w, "own_groups", 0, w->group_count, sizeof *w->groups, w->groups);
    w->array_count += kiln_company_arrays(s->company, w->blocks + w->array_count);
}

static int save_with(const struct kiln_saved *s, bool finished, const struct kiln_array_range *more, size_t more_count,
                     struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    const double start = MPI_Wtime();
    kiln_control_meet(p->control);
    kiln_control_blocking(p->control, "writing a checkpoint", 60.0 + (double)kiln_save_bytes(s) / WRITE_BYTES);
    if (!finished)
        kiln_step_work_settle(s->work, s->solution->own, p->node, kiln_node_data_count(s->solution->node_data));
    struct save_work w = {.state = state_of(s, finished), .sums = {.variance = sum_saved(&s->ledger->variance)}};
    for (int k = 0; k < KILN_SUMS; k++)
        w.sums.sums[k] = sum_saved(&s->ledger->sums[k]);
    int status = collect_steps(s, &w, error);
    if (status == KILN_OK && !finished)
        status = collect_groups(s, &w, error);
    if (status == KILN_OK && !finished)
        status = collect_done(s, &w, error);
    list_blocks(s, &w, finished);
    assert(w.array_count + more_count <= KILN_ARRAYS_MAX);
    for (size_t i = 0; i < more_count; i++)
        w.blocks[w.array_count++] = more[i];
    status = kiln_agree(p->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_write(p->checkpoint, p->identity, w.blocks, w.array_count, error);
    kiln_control_blocking(p->control, NULL, 0.0);
    kiln_trace_add(p->trace, KILN_TRACE_CHECKPOINT, "checkpoint", start, MPI_Wtime(), (int64_t)p->surface->count);
    if (status == KILN_OK)
        kiln_control_saved(p->control, kiln_checkpoint_last(p->checkpoint), MPI_Wtime() - start, (double)time(NULL));
    kiln_arena_release(&w.arena);
    return status;
}

int kiln_save(const struct kiln_saved *s, bool finished, struct kiln_error *error)
{
    return s->params->checkpoint != NULL ? save_with(s, finished, NULL, 0, error) : KILN_OK;
}

int kiln_save_solution(struct kiln_solution *solution, const struct kiln_integrate_params *params,
                       const struct kiln_array_range *more, size_t count, struct kiln_error *error)
{
    struct kiln_ledger none = {0};
    struct kiln_step_work done = {0};
    const struct kiln_saved saved = {params, solution, &none, &done, NULL};
    return save_with(&saved, true, more, count, error);
}

int kiln_save_and_stop(const struct kiln_saved *s, bool finished, struct kiln_error *error)
{
    if (s->params->checkpoint == NULL)
        return kiln_give_up(error);
    const int status = kiln_save(s, finished, error);
    return status == KILN_OK ? kiln_stopped(s->params->control, error) : status;
}

/* ---- reading ---- */

static int no_such_step(size_t number, struct kiln_error *error)
{
    return kiln_fail(error, KILN_IO,
                     "step %zu of the checkpoint is none of this bake's; give --no-resume to start from the beginning",
                     number);
}

static bool state_is_sane(const struct saved_state *state)
{
    enum { BOUNCES_MOST = 1 << 20 };
    bool sane = state->bounces <= BOUNCES_MOST && isfinite(state->tail_share) && isfinite(state->tail_sum_error) &&
                isfinite(state->tail_object_error) && isfinite(state->tail_tile_error) &&
                state->tail_pocket < UINT32_MAX && isfinite(state->seconds) && state->seconds >= 0.0 &&
                isfinite(state->merge_radius);
    if (state->finished == 0) /* no sums come after the last step */
        sane = sane && isfinite(state->unit) && state->unit > 0.0 && isfinite(state->unit_squared) &&
               state->unit_squared > 0.0;
    for (int c = 0; c < 3; c++)
        sane = sane && isfinite(state->tail_ratio[c]);
    return sane;
}

static bool groups_are_sane(const struct kiln_saved *s)
{
    bool sane = true;
    for (size_t i = 0; i < s->ledger->group_count; i++)
        sane = sane && isfinite(s->ledger->group_before[i]) && isfinite(s->ledger->group_total[i]);
    return sane;
}

static int restore_state(const struct kiln_saved *s, bool *finished, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = s->params->checkpoint;
    struct kiln_integrate_report *r = &s->solution->report;
    struct saved_state state;
    int status = kiln_checkpoint_read(c, "state", 0, 1, sizeof state, &state, error);
    if (status != KILN_OK)
        return status;
    *finished = state.finished != 0;
    r->bounces = state.bounces;
    r->tail = state.tail != 0;
    r->restarts = state.restarts + 1;
    r->seconds_before = state.seconds;
    r->landing.radius = state.merge_radius;
    r->tail_share = state.tail_share;
    r->tail_error = state.tail_sum_error;
    r->tail_object_error = state.tail_object_error;
    r->tail_tile_error = state.tail_tile_error;
    r->tail_pocket = (uint32_t)state.tail_pocket;
    memcpy(r->tail_ratio, state.tail_ratio, sizeof r->tail_ratio);
    s->ledger->unit = state.unit;
    s->ledger->unit_squared = state.unit_squared;
    if (!state_is_sane(&state))
        return kiln_array_insane("state", error);
    if (*finished)
        return KILN_OK;
    status = kiln_checkpoint_read(c, "group_before", 0, s->ledger->group_count, sizeof *s->ledger->group_before,
                                  s->ledger->group_before, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_read(c, "group_total", 0, s->ledger->group_count, sizeof *s->ledger->group_total,
                                      s->ledger->group_total, error);
    return status == KILN_OK && !groups_are_sane(s) ? kiln_array_insane("group_total", error) : status;
}

static bool report_is_sane(const struct saved_report *r)
{
    bool sane = r->tried <= 1 && r->left_out <= r->tried && isfinite(r->brings) && isfinite(r->rest) &&
                r->judged <= 1 && r->moved <= 1 && r->out_of_time <= 1 && isfinite(r->imbalance) && isfinite(r->gain) &&
                isfinite(r->cost) && isfinite(r->variance) && isfinite(r->tail_error) && isfinite(r->object_error) &&
                isfinite(r->unfinished) && isfinite(r->share);
    for (int c = 0; c < 3; c++)
        sane = sane && isfinite(r->incident[c]) && isfinite(r->reflected[c]) && isfinite(r->sent[c]) &&
               isfinite(r->escaped[c]) && isfinite(r->blocked[c]) && isfinite(r->glass[c]) && isfinite(r->gloss[c]) &&
               isfinite(r->unfound[c]);
    return sane;
}

/* Appends the report of a record. The integrator decides which step it is, and the record must agree. */
static int append_report(const struct kiln_saved *s, const struct saved_report *saved, struct kiln_error *error)
{
    const struct kiln_integrate_settings *settings = s->params->settings;
    struct kiln_step_reports *reports = &s->solution->report.steps;
    struct kiln_step_report report = report_read(saved);
    struct kiln_step step;
    if (!kiln_steps_next(settings, reports->of, reports->count, &step) || step.role != report.step.role ||
        step.bounce != report.step.bounce || step.samples != report.step.samples)
        return no_such_step(reports->count, error);
    report.step = step;
    reports->of[reports->count++] = report;
    return report_is_sane(saved) && kiln_companions_are_sane(s->params->companions, &report)
               ? KILN_OK
               : kiln_array_insane("steps", error);
}

/* Reads the records of steps. Their number `count` was checked before. */
static int read_reports(const struct kiln_saved *s, size_t count, struct kiln_error *error)
{
    struct saved_report *saved = NULL;
    int status;
    KILN_TRY(kiln_allocate(&saved, count, sizeof *saved, "a checkpoint's steps", error));
    KILN_TRY(kiln_checkpoint_read(s->params->checkpoint, "steps", 0, count, sizeof *saved, saved, error));
    for (size_t i = 0; i < count; i++)
        KILN_TRY(append_report(s, &saved[i], error));
end:
    kiln_free(&saved);
    return status;
}

static int restore_steps(const struct kiln_saved *s, struct kiln_error *error)
{
    uint64_t first, count;
    kiln_checkpoint_file_range(s->params->checkpoint, 0, "steps", &first, &count);
    if (count == 0 || count > STEPS_MOST)
        return kiln_fail(
            error, KILN_IO,
            "the checkpoint has %llu steps and 1 to %d are possible; give --no-resume to start from the beginning",
            (unsigned long long)count, (int)STEPS_MOST);
    s->solution->report.steps.count = 0;
    const int status = kiln_step_reports_reserve(&s->solution->report.steps, (size_t)count, error);
    return status == KILN_OK ? read_reports(s, (size_t)count, error) : status;
}

/* Restores the points. Which points are buried was found by the backend that began the bake; another backend may judge
 * points at edges differently. */
static int restore_points(const struct kiln_saved *s, uint64_t tile_run_first, bool finished, struct kiln_error *error)
{
    const struct kiln_save_moment moment = moment_of(s, tile_run_first, finished);
    bool changed = false;
    const int status =
        kiln_field_arrays_read(s->params->checkpoint, fields_of(s), s->solution->own, &moment, &changed, error);
    return status == KILN_OK && changed ? kiln_backend_set_surface(s->params->backend, s->params->surface, error)
                                        : status;
}

/* Adds one file's sums to this rank's. Any rank may do this, since only the total matters. */
static int add_part(const struct kiln_saved *s, size_t part, bool finished, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = s->params->checkpoint;
    struct kiln_integrate_report *r = &s->solution->report;
    struct saved_own_step *steps = NULL;
    struct saved_group *groups = NULL;
    struct saved_sums *sums = NULL;
    uint64_t count = 0;
    int status;
    KILN_TRY(kiln_checkpoint_read_file(c, part, "own_steps", sizeof *steps, &steps, &count, error));
    for (uint64_t i = 0; i < count && i < r->steps.count; i++) {
        r->steps.of[i].rays += steps[i].rays;
        r->steps.of[i].seconds += steps[i].seconds;
        r->steps.of[i].exchange_seconds += steps[i].exchange_seconds;
        r->steps.of[i].device_seconds += steps[i].device_seconds;
        r->steps.of[i].probe_rays += steps[i].probe_rays;
        r->steps.of[i].probe_seconds += steps[i].probe_seconds;
    }
    if (!finished)
        KILN_TRY(kiln_checkpoint_read_file(c, part, "own_sums", sizeof *sums, &sums, &count, error));
    for (int k = 0; !finished && count == 1 && k < KILN_SUMS; k++)
        s->ledger->sums[k].value += sum_read(&sums->sums[k]);
    if (!finished)
        s->ledger->variance.value += count == 1 ? sum_read(&sums->variance) : 0;
    if (!finished)
        KILN_TRY(kiln_checkpoint_read_file(c, part, "own_groups", sizeof *groups, &groups, &count, error));
    for (uint64_t i = 0; !finished && i < count; i++)
        if (groups[i].index < s->ledger->group_count)
            s->ledger->group_now[groups[i].index].value += sum_read(&groups[i].sum);
end:
    kiln_free(&steps);
    kiln_free(&groups);
    kiln_free(&sums);
    return status;
}

/* Finds this rank's first tile run that begins at or after a point. */
static size_t tile_run_at(const struct kiln_surface *surface, struct kiln_global_point point)
{
    size_t low = 0, high = surface->tile_run_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (surface->tile_runs[middle].first.at < point.at)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Restores the list of tile runs to do: everything between the finished ranges. Files and their ranges are in the order
 * of points. */
static int restore_todo(const struct kiln_saved *s, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = s->params->checkpoint;
    const struct kiln_surface *surface = s->params->surface;
    size_t at = 0;
    int status = KILN_OK;
    s->work->todo_first = s->work->todo_count = 0;
    s->work->points_done = surface->count;
    for (size_t part = 0; part < kiln_checkpoint_files(c) && status == KILN_OK; part++) {
        uint64_t first, count, ranges = 0;
        struct saved_range *done = NULL;
        kiln_checkpoint_file_range(c, part, "direct", &first, &count);
        if (count == 0 || first >= surface->first.at + surface->count || first + count <= surface->first.at)
            continue;
        status = kiln_checkpoint_read_file(c, part, "done", sizeof *done, &done, &ranges, error);
        for (uint64_t i = 0; i < ranges && status == KILN_OK; i++) {
            const size_t begin = tile_run_at(surface, (struct kiln_global_point){done[i].first}),
                         end = tile_run_at(surface, (struct kiln_global_point){done[i].first + done[i].count});
            status = kiln_step_work_add(s->work, at, begin, error);
            at = end > at ? end : at;
        }
        kiln_free(&done);
    }
    if (status == KILN_OK)
        status = kiln_step_work_add(s->work, at, surface->tile_run_count, error);
    for (size_t i = 0; i < s->work->todo_count; i++)
        for (size_t f = s->work->todo[i].first; f < s->work->todo[i].first + s->work->todo[i].count; f++)
            s->work->points_done -= surface->tile_runs[f].count;
    return status;
}

int kiln_restore(const struct kiln_saved *s, bool *finished, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    const uint64_t before = count_before(s);
    int status;
    KILN_TRY(restore_state(s, finished, error));
    KILN_TRY(restore_steps(s, error));
    KILN_TRY(restore_points(s, before, *finished, error));
    for (size_t part = (size_t)p->rank; part < kiln_checkpoint_files(p->checkpoint); part += (size_t)p->ranks)
        KILN_TRY(add_part(s, part, *finished, error));
    if (!*finished)
        KILN_TRY(restore_todo(s, error));
    if (!*finished)
        kiln_step_work_offer(s->work, s->solution->own);
end:
    return kiln_agree(p->communicator, status, error);
}
