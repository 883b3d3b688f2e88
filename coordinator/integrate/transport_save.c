#include <assert.h>
#include <math.h>
#include <string.h>
#include <time.h>

#include "coordinator/integrate/save.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"
#include "worker/scene/radiosity.h"

#define WRITE_BYTES 20e6 /* a second, at the slowest disk that is not taken for a dead one */

enum { PASSES_MOST = 10002 }; /* with the most bounces that can be asked for */
enum { POINT_BYTES = 12 + 12 + 2 + 2 + 8 + 8 };

/* What all ranks have the same. */
struct saved_state {
    uint32_t finished, bounces, tail, restarts;
    double tail_ratio[3], tail_share;
    double unit, unit_squared, seconds;
};

/* What a rank did in each pass. */
struct saved_pass {
    uint64_t rays;
    double seconds, exchange_seconds;
};

/* A group of tiles that has something. */
struct saved_group {
    uint64_t index, low;
    int64_t high;
};

struct saved_range {
    uint64_t first, count; /* points */
};

struct saved_sums {
    struct kiln_exact_sum pass[KILN_SUMS], variance;
};

uint64_t kiln_save_bytes(const struct kiln_saved *s) { return s->params->surface->point_count * POINT_BYTES; }

/* Whether the step under way gathers from radiosity, which then is saved too. */
static bool gathers(const struct kiln_saved *s) { return kiln_solution_step(s->solution)->step.pass->reads_radiosity; }

/* Bytes of a point in own->next. */
static size_t next_size(const struct kiln_saved *s)
{
    return kiln_solution_step(s->solution)->step.compact ? sizeof(uint32_t) : sizeof(uint64_t);
}

/* ---- writing ---- */

/* What is made for a checkpoint. */
struct save_work {
    struct saved_state state;
    struct saved_sums sums;
    struct saved_pass *passes;
    struct saved_group *groups;
    struct saved_range *done;
    size_t group_count, done_count;
    struct kiln_block blocks[KILN_BLOCKS_MAX];
    size_t block_count;
};

static void add_block(struct save_work *w, const char *name, uint64_t first, uint64_t count, size_t size,
                      const void *data)
{
    struct kiln_block *b = &w->blocks[w->block_count++];
    *b = (struct kiln_block){.first = first, .count = count, .size = size, .data = data};
    (void)strncpy(b->name, name, sizeof b->name - 1);
}

static struct saved_group group_saved(size_t index, const struct kiln_exact_sum *sum)
{
    return (struct saved_group){index, (uint64_t)sum->value, (int64_t)(sum->value >> 64)};
}

static int collect_groups(const struct kiln_saved *s, struct save_work *w, struct kiln_error *error)
{
    size_t count = 0;
    for (size_t i = 0; i < s->ledger->group_count; i++)
        count += s->ledger->group_now[i].value != 0;
    const int status = kiln_allocate(&w->groups, count, sizeof *w->groups, "a checkpoint's groups", error);
    for (size_t i = 0; status == KILN_OK && i < s->ledger->group_count; i++)
        if (s->ledger->group_now[i].value != 0)
            w->groups[w->group_count++] = group_saved(i, &s->ledger->group_now[i]);
    return status;
}

/* The points of the tile runs [first, end). */
static void add_done(const struct kiln_surface *surface, struct save_work *w, size_t first, size_t end)
{
    if (first >= end)
        return;
    const struct kiln_tile_run *last = &surface->tile_runs[end - 1];
    const uint64_t point = surface->tile_runs[first].first;
    w->done[w->done_count++] = (struct saved_range){point, last->first + last->count - point};
}

/* What lies between what is to do is done. */
static int collect_done(const struct kiln_saved *s, struct save_work *w, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->params->surface;
    const int status = kiln_allocate(&w->done, s->work->todo_count - s->work->todo_first + 1, sizeof *w->done,
                                     "a checkpoint's ranges", error);
    size_t at = 0;
    for (size_t i = s->work->todo_first; status == KILN_OK && i < s->work->todo_count; i++) {
        add_done(surface, w, at, s->work->todo[i].first);
        at = s->work->todo[i].first + s->work->todo[i].count;
    }
    if (status == KILN_OK)
        add_done(surface, w, at, surface->tile_run_count);
    return status;
}

static int collect_passes(const struct kiln_saved *s, struct save_work *w, struct kiln_error *error)
{
    const struct kiln_integrate_report *r = &s->solution->report;
    const int status = kiln_allocate(&w->passes, r->steps.count, sizeof *w->passes, "a checkpoint's passes", error);
    for (size_t i = 0; status == KILN_OK && i < r->steps.count; i++)
        w->passes[i] =
            (struct saved_pass){r->steps.of[i].rays, r->steps.of[i].seconds, r->steps.of[i].exchange_seconds};
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
                                .unit = s->ledger->unit,
                                .unit_squared = s->ledger->unit_squared,
                                .seconds = r->seconds_before + MPI_Wtime() - s->params->begin};
    memcpy(state.tail_ratio, r->tail_ratio, sizeof state.tail_ratio);
    return state;
}

static void list_blocks(const struct kiln_saved *s, struct save_work *w, bool finished)
{
    const struct kiln_surface *surface = s->params->surface;
    const struct kiln_integrate_report *r = &s->solution->report;
    const uint64_t first = surface->first, count = surface->count;
    if (s->params->rank == 0) {
        add_block(w, "state", 0, 1, sizeof w->state, &w->state);
        add_block(w, "passes", 0, r->steps.count, sizeof *r->steps.of, r->steps.of);
    }
    if (s->params->rank == 0 && !finished) {
        add_block(w, "group_before", 0, s->ledger->group_count, sizeof *s->ledger->group_before,
                  s->ledger->group_before);
        add_block(w, "group_total", 0, s->ledger->group_count, sizeof *s->ledger->group_total, s->ledger->group_total);
    }
    add_block(w, "own_passes", 0, r->steps.count, sizeof *w->passes, w->passes);
    add_block(w, "direct", first, count, 3 * sizeof(float), s->solution->direct);
    add_block(w, "sum", first, count, 3 * sizeof(float), s->solution->own->sum);
    add_block(w, "error", first, count, sizeof *s->solution->error, s->solution->error);
    add_block(w, "visible", first, count, sizeof *surface->visible, surface->visible);
    if (finished)
        return;
    add_block(w, "done", 0, w->done_count, sizeof *w->done, w->done);
    add_block(w, "own_sums", 0, 1, sizeof w->sums, &w->sums);
    add_block(w, "own_groups", 0, w->group_count, sizeof *w->groups, w->groups);
    add_block(w, "next", first, count, next_size(s), s->solution->own->next);
    if (gathers(s))
        add_block(w, "source", first, count, sizeof *s->solution->radiosity, s->solution->radiosity + first);
}

static int save_with(const struct kiln_saved *s, bool finished, const struct kiln_block *more, size_t more_count,
                     struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    const double start = MPI_Wtime();
    kiln_control_meet(p->control);
    kiln_control_blocking(p->control, "writing a checkpoint", 60.0 + (double)kiln_save_bytes(s) / WRITE_BYTES);
    if (!finished)
        kiln_step_work_settle(s->work, s->solution->own, p->node, kiln_node_data_count(s->solution->node_data));
    struct save_work w = {.state = state_of(s, finished), .sums = {.variance = s->ledger->variance}};
    memcpy(w.sums.pass, s->ledger->sums, sizeof s->ledger->sums);
    int status = collect_passes(s, &w, error);
    if (status == KILN_OK && !finished)
        status = collect_groups(s, &w, error);
    if (status == KILN_OK && !finished)
        status = collect_done(s, &w, error);
    list_blocks(s, &w, finished);
    assert(w.block_count + more_count <= KILN_BLOCKS_MAX);
    for (size_t i = 0; i < more_count; i++)
        w.blocks[w.block_count++] = more[i];
    status = kiln_agree(p->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_write(p->checkpoint, p->identity, w.blocks, w.block_count, error);
    kiln_control_blocking(p->control, NULL, 0.0);
    kiln_trace_add(p->trace, KILN_TRACE_CHECKPOINT, "checkpoint", start, MPI_Wtime(), (int64_t)p->surface->count);
    if (status == KILN_OK)
        kiln_control_saved(p->control, kiln_checkpoint_last(p->checkpoint), MPI_Wtime() - start, (double)time(NULL));
    kiln_free(&w.passes);
    kiln_free(&w.groups);
    kiln_free(&w.done);
    return status;
}

int kiln_save(const struct kiln_saved *s, bool finished, struct kiln_error *error)
{
    return save_with(s, finished, NULL, 0, error);
}

int kiln_integrate_save(struct kiln_solution *solution, const struct kiln_integrate_params *params,
                        const struct kiln_block *more, size_t count, struct kiln_error *error)
{
    struct kiln_ledger none = {0};
    struct kiln_step_work done = {0};
    const struct kiln_saved saved = {params, solution, &none, &done};
    return save_with(&saved, true, more, count, error);
}

int kiln_save_and_stop(const struct kiln_saved *s, bool finished, struct kiln_error *error)
{
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

static int no_such_value(const char *name, struct kiln_error *error)
{
    return kiln_fail(
        error, KILN_IO,
        "the checkpoint has values in '%s' that no bake can have; give --no-resume to start from the beginning", name);
}

static bool state_is_sane(const struct saved_state *state)
{
    enum { BOUNCES_MOST = 1 << 20 };
    bool sane = state->bounces <= BOUNCES_MOST && isfinite(state->tail_share) && isfinite(state->seconds) &&
                state->seconds >= 0.0;
    if (state->finished == 0) /* no sums come after the last pass */
        sane = sane && isfinite(state->unit) && state->unit > 0.0 && isfinite(state->unit_squared) &&
               state->unit_squared > 0.0;
    for (int c = 0; c < 3; c++)
        sane = sane && isfinite(state->tail_ratio[c]);
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
    r->tail_share = state.tail_share;
    memcpy(r->tail_ratio, state.tail_ratio, sizeof r->tail_ratio);
    s->ledger->unit = state.unit;
    s->ledger->unit_squared = state.unit_squared;
    if (!state_is_sane(&state))
        return no_such_value("state", error);
    if (*finished)
        return KILN_OK;
    status = kiln_checkpoint_read(c, "group_before", 0, s->ledger->group_count, sizeof *s->ledger->group_before,
                                  s->ledger->group_before, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_read(c, "group_total", 0, s->ledger->group_count, sizeof *s->ledger->group_total,
                                      s->ledger->group_total, error);
    return status;
}

/* A file may have any byte where a bool was. */
static bool balance_is_sane(const struct kiln_step_balance *b)
{
    unsigned char judged, moved;
    memcpy(&judged, &b->judged, 1);
    memcpy(&moved, &b->moved, 1);
    return judged <= 1 && moved <= 1 && isfinite(b->imbalance) && isfinite(b->gain) && isfinite(b->cost);
}

/* The integrator says what step it is; what the file says of that must agree. */
static int restore_step(const struct kiln_saved *s, size_t i, struct kiln_error *error)
{
    const struct kiln_integrate_settings *settings = s->params->settings;
    struct kiln_step_report *report = &s->solution->report.steps.of[i];
    struct kiln_step step;
    if (!settings->integrator->next(settings, s->solution->report.steps.of, i, &step) ||
        step.role != report->step.role || step.bounce != report->step.bounce || step.samples != report->step.samples)
        return no_such_step(i, error);
    report->step = step;
    return balance_is_sane(&report->balance) && isfinite(report->tail_error) ? KILN_OK : no_such_value("passes", error);
}

static int restore_passes(const struct kiln_saved *s, struct kiln_error *error)
{
    struct kiln_integrate_report *r = &s->solution->report;
    uint64_t first, count;
    kiln_checkpoint_part_range(s->params->checkpoint, 0, "passes", &first, &count);
    if (count == 0 || count > PASSES_MOST)
        return kiln_fail(
            error, KILN_IO,
            "the checkpoint has %llu passes and 1 to %d are possible; give --no-resume to start from the beginning",
            (unsigned long long)count, (int)PASSES_MOST);
    int status = kiln_step_reports_reserve(&r->steps, (size_t)count, error);
    if (status == KILN_OK)
        status =
            kiln_checkpoint_read(s->params->checkpoint, "passes", 0, count, sizeof *r->steps.of, r->steps.of, error);
    if (status != KILN_OK)
        return status;
    r->steps.count = (size_t)count;
    for (size_t i = 0; i < r->steps.count && status == KILN_OK; i++) {
        struct kiln_step_report *report = &r->steps.of[i];
        status = restore_step(s, i, error);
        report->rays = 0; /* these are of the ranks that did them */
        report->given = report->taken = 0;
        report->seconds = report->exchange_seconds = 0.0;
    }
    return status;
}

/* What a bake can have come to: sums of these are taken in fixed point, where others have no place. */
static bool floats_are_sane(const float *values, uint64_t count)
{
    bool sane = true;
    for (uint64_t i = 0; i < count; i++)
        sane = sane && fabsf(values[i]) < 1e36f; /* not so for what is no number */
    return sane;
}

static bool doubles_are_sane(const double *values, size_t count)
{
    bool sane = true;
    for (size_t i = 0; i < count; i++)
        sane = sane && isfinite(values[i]);
    return sane;
}

static bool errors_are_sane(const uint16_t *values, uint64_t count)
{
    bool sane = true;
    for (uint64_t i = 0; i < count; i++)
        sane = sane && isfinite(kiln_error_unpack(values[i]));
    return sane;
}

static bool radiosities_are_sane(const uint64_t *values, uint64_t count)
{
    bool sane = true;
    for (uint64_t i = 0; i < count; i++) {
        float rgb[3];
        kiln_radiosity_unpack(values[i], rgb);
        sane = sane && floats_are_sane(rgb, 3);
    }
    return sane;
}

static int check_points(const struct kiln_saved *s, bool finished, struct kiln_error *error)
{
    const uint64_t count = s->params->surface->count;
    const bool has_source = !finished && gathers(s);
    if (!floats_are_sane(s->solution->direct, 3 * count))
        return no_such_value("direct", error);
    if (!floats_are_sane(s->solution->own->sum, 3 * count))
        return no_such_value("sum", error);
    if (!errors_are_sane(s->solution->error, count))
        return no_such_value("error", error);
    if (!finished && next_size(s) == sizeof(uint64_t) && /* any value of the 4-byte form is finite */
        !radiosities_are_sane(s->solution->own->next, count))
        return no_such_value("next", error);
    if (has_source && !radiosities_are_sane(s->solution->radiosity + s->params->surface->first, count))
        return no_such_value("source", error);
    if (!finished && (!doubles_are_sane(s->ledger->group_before, s->ledger->group_count) ||
                      !doubles_are_sane(s->ledger->group_total, s->ledger->group_count)))
        return no_such_value("group_total", error);
    return KILN_OK;
}

static int restore_points(const struct kiln_saved *s, bool finished, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = s->params->checkpoint;
    const struct kiln_surface *surface = s->params->surface;
    const uint64_t first = surface->first, count = surface->count;
    int status = kiln_checkpoint_read(c, "direct", first, count, 3 * sizeof(float), s->solution->direct, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_read(c, "sum", first, count, 3 * sizeof(float), s->solution->own->sum, error);
    if (status == KILN_OK)
        status = kiln_checkpoint_read(c, "error", first, count, sizeof *s->solution->error, s->solution->error, error);
    if (status == KILN_OK && !finished)
        status = kiln_checkpoint_read(c, "next", first, count, next_size(s), s->solution->own->next, error);
    if (status == KILN_OK && !finished && gathers(s))
        status = kiln_checkpoint_read(c, "source", first, count, sizeof *s->solution->radiosity,
                                      s->solution->radiosity + first, error);
    return status == KILN_OK ? check_points(s, finished, error) : status;
}

/* What is buried was found by the backend that began; another one may see a point at the edge otherwise. */
static int restore_visible(const struct kiln_saved *s, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->params->surface;
    uint16_t *visible = NULL;
    int status = kiln_allocate(&visible, surface->count, sizeof *visible, "the buried points", error);
    if (status == KILN_OK)
        status = kiln_checkpoint_read(s->params->checkpoint, "visible", surface->first, surface->count, sizeof *visible,
                                      visible, error);
    if (status == KILN_OK && memcmp(visible, surface->visible, surface->count * sizeof *visible) != 0) {
        memcpy(surface->visible, visible, surface->count * sizeof *visible);
        status = kiln_backend_set_surface(s->params->backend, surface, error);
    }
    kiln_free(&visible);
    return status;
}

/* Adds one file's sums to this rank's: which rank does that makes no difference to the total. */
static int add_part(const struct kiln_saved *s, size_t part, bool finished, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = s->params->checkpoint;
    struct kiln_integrate_report *r = &s->solution->report;
    struct saved_pass *passes = NULL;
    struct saved_group *groups = NULL;
    struct saved_sums *sums = NULL;
    uint64_t count = 0;
    int status = kiln_checkpoint_read_part(c, part, "own_passes", sizeof *passes, &passes, &count, error);
    for (uint64_t i = 0; status == KILN_OK && i < count && i < r->steps.count; i++) {
        r->steps.of[i].rays += passes[i].rays;
        r->steps.of[i].seconds += passes[i].seconds;
        r->steps.of[i].exchange_seconds += passes[i].exchange_seconds;
    }
    if (status == KILN_OK && !finished)
        status = kiln_checkpoint_read_part(c, part, "own_sums", sizeof *sums, &sums, &count, error);
    for (int k = 0; status == KILN_OK && !finished && count == 1 && k < KILN_SUMS; k++)
        s->ledger->sums[k].value += sums->pass[k].value;
    if (status == KILN_OK && !finished)
        s->ledger->variance.value += count == 1 ? sums->variance.value : 0;
    if (status == KILN_OK && !finished)
        status = kiln_checkpoint_read_part(c, part, "own_groups", sizeof *groups, &groups, &count, error);
    for (uint64_t i = 0; status == KILN_OK && !finished && i < count; i++)
        if (groups[i].index < s->ledger->group_count)
            s->ledger->group_now[groups[i].index].value +=
                (__int128)groups[i].high * ((__int128)1 << 64) + (__int128)groups[i].low;
    kiln_free(&passes);
    kiln_free(&groups);
    kiln_free(&sums);
    return status;
}

/* The first own tile run that begins at or after a point. */
static size_t tile_run_at(const struct kiln_surface *surface, uint64_t point)
{
    size_t low = 0, high = surface->tile_run_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (surface->tile_runs[middle].first < point)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Files and the ranges in them are in order of points, so what is between the done ranges is to do. */
static int restore_todo(const struct kiln_saved *s, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = s->params->checkpoint;
    const struct kiln_surface *surface = s->params->surface;
    size_t at = 0;
    int status = KILN_OK;
    s->work->todo_first = s->work->todo_count = 0;
    s->work->points_done = surface->count;
    for (size_t part = 0; part < kiln_checkpoint_parts(c) && status == KILN_OK; part++) {
        uint64_t first, count, ranges = 0;
        struct saved_range *done = NULL;
        kiln_checkpoint_part_range(c, part, "direct", &first, &count);
        if (count == 0 || first >= surface->first + surface->count || first + count <= surface->first)
            continue;
        status = kiln_checkpoint_read_part(c, part, "done", sizeof *done, &done, &ranges, error);
        for (uint64_t i = 0; i < ranges && status == KILN_OK; i++) {
            const size_t begin = tile_run_at(surface, done[i].first),
                         end = tile_run_at(surface, done[i].first + done[i].count);
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
    int status = restore_state(s, finished, error);
    if (status == KILN_OK)
        status = restore_passes(s, error);
    if (status == KILN_OK)
        status = restore_points(s, *finished, error);
    if (status == KILN_OK)
        status = restore_visible(s, error);
    for (size_t part = (size_t)p->rank; status == KILN_OK && part < kiln_checkpoint_parts(p->checkpoint);
         part += (size_t)p->ranks)
        status = add_part(s, part, *finished, error);
    if (status == KILN_OK && !*finished)
        status = restore_todo(s, error);
    if (status == KILN_OK && !*finished)
        kiln_step_work_offer(s->work, s->solution->own);
    return kiln_agree(p->communicator, status, error);
}
