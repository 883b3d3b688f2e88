#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bake/transport_private.h"
#include "coordinator/cli/agree.h"
#include "shaders/random.h"
#include "worker/base/memory.h"
#include "worker/scene/radiosity.h"

static const char *const pass_names[] = {"direct light", "bounce", "final gather"}; /* in the order of enum kiln_pass_kind */

#define RATE_START 1e6    /* rays a second and thread, to begin with */

static void take_direct(struct transport_state *s, uint64_t own, const struct kiln_point_result *r, float radiosity[3])
{
    for (uint64_t c = 0; c < 3; c++) {
        s->out->direct[3 * own + c] = r->irradiance[c];
        s->sum[3 * own + c] = radiosity[c];
    }
    s->out->error[own] = kiln_error_pack(r->error);
}

static void take_bounce(struct transport_state *s, uint64_t own, const struct kiln_point_result *r, float radiosity[3])
{
    (void)r;
    for (uint64_t c = 0; c < 3; c++)
        s->sum[3 * own + c] += radiosity[c];
}

static void add_error(struct transport_state *s, uint64_t own, float error)
{
    s->out->error[own] = kiln_error_pack(hypotf(kiln_error_unpack(s->out->error[own]), error));
}

/* The final gather's answer replaces the sum it was gathered from (which everybody has packed by now). */
static void take_final(struct transport_state *s, uint64_t own, const struct kiln_point_result *r, float radiosity[3])
{
    (void)radiosity;
    for (uint64_t c = 0; c < 3; c++)
        s->sum[3 * own + c] = r->irradiance[c];
    add_error(s, own, r->error);
}

/* Equal schedule: every bounce's irradiance counts as it is. */
static void take_equal(struct transport_state *s, uint64_t own, const struct kiln_point_result *r, float radiosity[3])
{
    (void)radiosity;
    for (uint64_t c = 0; c < 3; c++)
        s->sum[3 * own + c] += r->irradiance[c];
    add_error(s, own, r->error);
}

void transport_step_make(const struct transport_state *s, enum kiln_pass_kind kind, uint32_t bounce, struct transport_step *step)
{
    const struct kiln_job *job = s->params->job;
    const bool equal = job->schedule == KILN_SCHEDULE_EQUAL;
    *step = (struct transport_step){.kind = kind, .bounce = bounce};
    switch (kind) {
    case KILN_PASS_DIRECT:
        step->samples = job->samples_direct;
        step->take = take_direct;
        break;
    case KILN_PASS_BOUNCE:
        step->samples = equal ? job->samples_indirect : job->samples_bounce;
        step->stream = bounce;
        step->take = equal ? take_equal : take_bounce;
        break;
    case KILN_PASS_FINAL:
        step->samples = job->samples_indirect;
        step->stream = FINAL_STREAM;
        step->take = take_final;
        break;
    }
}

/* What one fragment adds, kept apart until all are done: threads share the fragments, but tiles of one group meet. */
struct fragment_sum {
    struct kiln_exact_sum reflected; /* luminance */
    double variance;
};

/* A pass under way. */
struct pass_work {
    struct transport_state *state;
    struct kiln_pass_report *pass;
    struct fragment_sum *fragments; /* of the part being taken */
    size_t fragment_room;
};

static size_t group_of(const struct kiln_surface *surface, const struct kiln_fragment *f)
{
    return (size_t)((surface->lightmaps[f->object].tile_first + f->tile) / GROUP_TILES);
}

static void add_energy(const struct pass_work *w, uint64_t own, const struct kiln_point_result *r, struct kiln_exact_sum sums[SUM_COUNT],
                       struct fragment_sum *fragment)
{
    const struct transport_state *s = w->state;
    const struct kiln_surface *surface = s->params->surface;
    const bool gather = w->pass->kind != KILN_PASS_DIRECT;
    if (!kiln_point_valid(surface, own))
        return;
    const double area = (double)surface->area[own] * ((double)surface->visible[own] / 65535.0) * (double)r->present;
    float albedo[3], sent[3] = {0};
    transport_albedo(surface, own, albedo);
    if (gather)
        kiln_radiosity_unpack(s->out->radiosity[surface->first + own], sent);
    double power[3], reflected[3];
    for (int c = 0; c < 3; c++) {
        const double incident = area * (double)r->incident[c];
        power[c] = area * (double)sent[c];
        reflected[c] = incident * (double)albedo[c];
        kiln_exact_add(&sums[SUM_INCIDENT + c], incident, s->unit);
        kiln_exact_add(&sums[SUM_REFLECTED + c], reflected[c], s->unit);
        kiln_exact_add(&sums[SUM_SENT + c], power[c], s->unit);
        kiln_exact_add(&sums[SUM_ESCAPED + c], power[c] * (double)r->escaped, s->unit);
        kiln_exact_add(&sums[SUM_BLOCKED + c], power[c] * (double)r->blocked, s->unit);
        kiln_exact_add(&sums[SUM_BEHIND + c], power[c] * (double)r->behind, s->unit);
        kiln_exact_add(&sums[SUM_BORROWED + c], area * (double)r->borrowed[c], s->unit);
    }
    kiln_exact_add(&fragment->reflected, kiln_luminance(reflected), s->unit);
    const double lost = fmin(1.0, (double)r->escaped + (double)r->blocked + (double)r->behind), spread = kiln_luminance(power);
    fragment->variance += area * area * (double)r->error * (double)r->error +
                          (gather ? spread * spread * lost * (1.0 - lost) / w->pass->samples : 0.0);
}

/* Random bits for the 4-byte form: those of the tile, moved on for each texel by its bit reversed, so that every aligned square of texels
 * rounds up and down in turn, and its mean is kept much better than by chance (a rotated van der Corput sequence). */
static uint32_t compact_hash(const struct transport_state *s, const struct kiln_fragment *f, uint32_t bit)
{
    const uint32_t tile = kiln_hash2(transport_pack_hash(f, 0, s->step.stream), (uint32_t)s->params->job->seed);
    uint32_t reversed = 0;
    for (uint32_t i = 0; i < 6; i++)
        reversed |= (bit >> i & 1u) << (9 - i);
    return ((tile + reversed) & 1023u) | (((tile >> 10) + reversed) & 1023u) << 10 | (((tile >> 20) + reversed) & 1023u) << 20;
}

/* A texel's radiosity as it goes to the next bounce. */
static uint64_t packed(const struct transport_state *s, const struct kiln_fragment *f, uint32_t bit, const float radiosity[3])
{
    if (!s->compact)
        return kiln_radiosity_pack(radiosity, transport_pack_hash(f, bit, s->step.stream));
    float rounded[3];
    kiln_radiosity_expand(kiln_radiosity_compact(radiosity, s->scale, compact_hash(s, f, bit)), s->scale, rounded);
    return kiln_radiosity_pack(rounded, 0);
}

/* Takes over the answers of one fragment, `results` being those of its points. */
static void take_fragment(const struct pass_work *w, const struct kiln_fragment *fragment, const struct kiln_point_result *results,
                          struct kiln_exact_sum sums[SUM_COUNT], struct fragment_sum *sum)
{
    struct transport_state *s = w->state;
    uint64_t own = fragment->first - s->params->surface->first;
    *sum = (struct fragment_sum){0};
    for (uint64_t rest = fragment->mask; rest != 0; rest &= rest - 1, own++, results++) {
        float albedo[3], radiosity[3];
        transport_albedo(s->params->surface, own, albedo);
        for (int c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * results->incident[c];
        add_energy(w, own, results, sums, sum);
        s->step.take(s, own, results, radiosity);
        s->next[own] = packed(s, fragment, (uint32_t)__builtin_ctzll(rest), radiosity);
    }
}

/* All own fragments before `end` are done: what of them is a whole group may leave. */
static void send_done(struct transport_state *s, size_t end)
{
    const struct kiln_surface *surface = s->params->surface;
    if (s->early && surface->fragment_count > 0)
        kiln_spread_advance(s->out->spread, s->next, (end < surface->fragment_count ? surface->fragments[end].first - surface->first : surface->count));
}

/* kiln_take_results of all passes. */
static int take_part(void *context, size_t first, size_t count, const struct kiln_point_result *results, struct kiln_error *error)
{
    struct pass_work *w = context;
    struct transport_state *s = w->state;
    const struct kiln_transport_params *p = s->params;
    const struct kiln_fragment *fragments = p->surface->fragments + first;
    const int status = kiln_grow(&w->fragments, &w->fragment_room, count, sizeof *w->fragments, "a part's sums", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel num_threads((int)p->threads)
    {
        struct kiln_exact_sum own[SUM_COUNT] = {0};
#pragma omp for schedule(static)
        for (size_t i = 0; i < count; i++)
            take_fragment(w, &fragments[i], results + (fragments[i].first - fragments[0].first), own, &w->fragments[i]);
#pragma omp critical(kiln_take_part)
        for (int k = 0; k < SUM_COUNT; k++) /* exact: the order of threads does not matter */
            s->sums[k].value += own[k].value;
    }
    for (size_t i = 0; i < count; i++) {
        s->group_now[group_of(p->surface, &fragments[i])].value += w->fragments[i].reflected.value;
        kiln_exact_add(&s->variance, w->fragments[i].variance, s->unit_squared);
        s->points_done += fragments[i].count;
    }
    kiln_progress_advance(p->progress, s->points_done);
    send_done(s, first + count);
    return KILN_OK;
}

static void show_pass(const struct transport_state *s)
{
    char name[64];
    (void)snprintf(name, sizeof name, "bounce %u", s->step.bounce);
    const char *text = s->step.kind == KILN_PASS_DIRECT ? "direct light" : s->step.kind == KILN_PASS_FINAL ? "final gather" : name;
    kiln_progress_phase(s->params->progress, text, s->params->surface->count);
    if (s->points_done > 0)
        kiln_progress_advance(s->params->progress, s->points_done);
    kiln_control_begin(s->params->control, text);
}

int transport_pass_begin(struct transport_state *s, struct kiln_error *error)
{
    struct kiln_transport_report *report = &s->out->report;
    report->passes[report->pass_count++] = (struct kiln_pass_report){.kind = s->step.kind, .bounce = s->step.bounce, .samples = s->step.samples};
    memset(s->sums, 0, sizeof s->sums);
    s->variance.value = 0;
    memset(s->group_now, 0, s->group_count * sizeof *s->group_now);
    s->points_done = 0;
    s->todo_first = 0;
    s->todo_count = s->params->surface->fragment_count > 0 ? 1 : 0;
    const int status = kiln_grow(&s->todo, &s->todo_room, 1, sizeof *s->todo, "what a pass has to do", error);
    if (status == KILN_OK)
        s->todo[0] = (struct fragment_range){0, s->params->surface->fragment_count};
    return kiln_agree(s->params->communicator, status, error);
}

/* How many fragments of the next range make a batch: one a thread at least, so that no core is idle. */
static size_t batch_of(const struct transport_state *s, const struct fragment_range *range)
{
    const struct kiln_fragment *fragments = s->params->surface->fragments + range->first;
    const double wanted = s->rate * kiln_control_batch_seconds(s->params->control) / (double)s->step.samples;
    size_t count = 0;
    for (uint64_t points = 0; count < range->count && (count < s->params->threads || (double)points < wanted); count++)
        points += fragments[count].count;
    return count;
}

/* A batch's speed; not believed at once when it is much higher than before, as a device's first launches are slow. */
static void note_rate(struct transport_state *s, uint64_t points, double seconds)
{
    const double rate = (double)points * (double)s->step.samples / fmax(seconds, 1e-6);
    s->rate = fmin(rate, 4.0 * s->rate);
}

/* Traces the next batch; what it did is no longer to do. */
static int run_batch(struct pass_work *w, double *seconds, struct kiln_error *error)
{
    struct kiln_backend_info begin, end;
    struct transport_state *s = w->state;
    const struct kiln_transport_params *p = s->params;
    struct fragment_range *range = &s->todo[s->todo_first];
    const struct kiln_batch batch = {range->first, batch_of(s, range), take_part, w};
    const uint64_t before = s->points_done;
    kiln_backend_info(p->backend, &begin);
    const double start = MPI_Wtime();
    const int status = s->step.kind == KILN_PASS_DIRECT
                           ? kiln_backend_direct(p->backend, &batch, s->step.samples, &w->pass->rays, error)
                           : kiln_backend_gather(p->backend, &batch, s->step.samples, s->step.stream, &w->pass->rays, error);
    *seconds = MPI_Wtime() - start;
    kiln_backend_info(p->backend, &end);
    w->pass->seconds += *seconds;
    kiln_trace_add(p->trace, KILN_TRACE_BATCH, "batch", start, start + *seconds, (int64_t)(s->points_done - before));
    w->pass->device_seconds += fmax(0.0, end.device_seconds - begin.device_seconds);
    note_rate(s, s->points_done - before, *seconds);
    range->first += batch.fragment_count;
    range->count -= batch.fragment_count;
    if (range->count == 0)
        s->todo_first++;
    return status;
}

static double share_done(const struct transport_state *s)
{
    const uint64_t count = s->params->surface->count;
    return count > 0 ? (double)s->points_done / (double)count : 1.0;
}

static enum kiln_event wait_for_others(struct transport_state *s, int status)
{
    const double start = MPI_Wtime();
    send_done(s, s->todo_first < s->todo_count ? s->todo[s->todo_first].first : s->params->surface->fragment_count);
    const enum kiln_event event = kiln_control_wait(s->params->control, status);
    const double end = MPI_Wtime();
    s->out->report.waiting_seconds += end - start;
    kiln_trace_add(s->params->trace, KILN_TRACE_WAIT, "for other ranks", start, end, -1);
    return event;
}

/* Until all ranks are done, or one says otherwise. */
static int run_batches(struct pass_work *w, struct kiln_error *error)
{
    struct transport_state *s = w->state;
    struct kiln_control *control = s->params->control;
    int status = s->step.kind == KILN_PASS_DIRECT ? KILN_OK : kiln_backend_set_radiosity(s->params->backend, s->out->radiosity, error);
    for (;;) {
        enum kiln_event event;
        if (status == KILN_OK && s->todo_first < s->todo_count) {
            double seconds = 0.0;
            status = run_batch(w, &seconds, error);
            event = kiln_control_poll(control, s->todo_first == s->todo_count, share_done(s), seconds, status);
        } else {
            event = wait_for_others(s, status);
        }
        switch (event) {
        case KILN_EVENT_NONE:
            break;
        case KILN_EVENT_SAVE: {
            const int saved = transport_save(s, false, error);
            if (saved != KILN_OK)
                return saved;
            break;
        }
        case KILN_EVENT_STOP:
            return transport_stop(s, false, error);
        case KILN_EVENT_FAIL:
        case KILN_EVENT_DONE:
            return kiln_agree(s->params->communicator, status, error);
        }
    }
}

/* Adds up over the ranks. Collective. */
static int close_pass(struct transport_state *s, struct kiln_pass_report *pass, struct kiln_error *error)
{
    struct kiln_exact_sum sums[SUM_COUNT + 1];
    memcpy(sums, s->sums, sizeof s->sums);
    sums[SUM_COUNT] = s->variance;
    const int status = kiln_exact_reduce(s->params->communicator, sums, SUM_COUNT + 1, error);
    for (int c = 0; c < 3; c++) {
        pass->energy.incident[c] = kiln_exact_value(&sums[SUM_INCIDENT + c], s->unit);
        pass->energy.reflected[c] = kiln_exact_value(&sums[SUM_REFLECTED + c], s->unit);
        pass->energy.sent[c] = kiln_exact_value(&sums[SUM_SENT + c], s->unit);
        pass->energy.escaped[c] = kiln_exact_value(&sums[SUM_ESCAPED + c], s->unit);
        pass->energy.blocked[c] = kiln_exact_value(&sums[SUM_BLOCKED + c], s->unit);
        pass->energy.behind[c] = kiln_exact_value(&sums[SUM_BEHIND + c], s->unit);
        pass->energy.borrowed[c] = kiln_exact_value(&sums[SUM_BORROWED + c], s->unit);
    }
    pass->energy.variance = kiln_exact_value(&sums[SUM_COUNT], s->unit_squared);
    return status;
}

int transport_pass_run(struct transport_state *s, struct kiln_error *error)
{
    struct pass_work w = {.state = s, .pass = &s->out->report.passes[s->out->report.pass_count - 1]};
    if (!(s->rate > 0.0))
        s->rate = RATE_START * s->params->threads;
    show_pass(s);
    transport_choose_form(s);
    kiln_spread_begin(s->out->spread);
    const double start = MPI_Wtime();
    int status = run_batches(&w, error);
    if (status != KILN_OK)
        kiln_spread_abandon(s->out->spread);
    kiln_trace_add(s->params->trace, KILN_TRACE_PASS, pass_names[s->step.kind], start, MPI_Wtime(), (int64_t)s->params->surface->count);
    kiln_free(&w.fragments);
    kiln_control_blocking(s->params->control, "adding up a pass", 0.0);
    if (status == KILN_OK)
        status = close_pass(s, w.pass, error);
    kiln_control_blocking(s->params->control, NULL, 0.0);
    return status;
}
