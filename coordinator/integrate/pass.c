#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/integrate/transport_private.h"
#include "coordinator/mpi/agree.h"
#include "worker/sampling/keys.h"
#include "worker/base/memory.h"
#include "worker/scene/radiosity.h"

/* in the order of enum kiln_pass_kind */
static const char *const pass_names[] = {"direct light", "bounce", "final gather"};

/* rays a second and thread, to begin with: little, so that the first batch is short however slow they are */
#define RATE_START 2e4

static void take_direct(const struct kiln_rank_data *share, uint64_t own, const struct kiln_point_result *r,
                        float radiosity[3])
{
    for (uint64_t c = 0; c < 3; c++) {
        share->direct[3 * own + c] = r->irradiance[c];
        share->sum[3 * own + c] = radiosity[c];
    }
    share->error[own] = kiln_error_pack(r->error);
}

static void take_bounce(const struct kiln_rank_data *share, uint64_t own, const struct kiln_point_result *r,
                        float radiosity[3])
{
    (void)r;
    for (uint64_t c = 0; c < 3; c++)
        share->sum[3 * own + c] += radiosity[c];
}

static void add_error(const struct kiln_rank_data *share, uint64_t own, float error)
{
    const double before = (double)kiln_error_unpack(share->error[own]);
    share->error[own] = kiln_error_pack((float)sqrt(before * before + (double)error * (double)error));
}

/* The final gather's answer replaces the sum it was gathered from (which everybody has packed by now). */
static void take_final(const struct kiln_rank_data *share, uint64_t own, const struct kiln_point_result *r,
                       float radiosity[3])
{
    (void)radiosity;
    for (uint64_t c = 0; c < 3; c++)
        share->sum[3 * own + c] = r->irradiance[c];
    add_error(share, own, r->error);
}

/* Equal schedule: every bounce's irradiance counts as it is. */
static void take_equal(const struct kiln_rank_data *share, uint64_t own, const struct kiln_point_result *r,
                       float radiosity[3])
{
    (void)radiosity;
    for (uint64_t c = 0; c < 3; c++)
        share->sum[3 * own + c] += r->irradiance[c];
    add_error(share, own, r->error);
}

void transport_step_make(const struct transport_state *s, enum kiln_pass_kind kind, uint32_t bounce,
                         struct transport_step *step)
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

/* What one tile run adds, kept apart until all are done: threads share the tile runs, but tiles of one group meet. */
struct tile_run_sum {
    struct kiln_exact_sum reflected; /* luminance */
    double variance;
};

static size_t group_of(const struct kiln_surface *surface, const struct kiln_tile_run *f)
{
    return (size_t)((surface->lightmaps[f->map].tile_first + f->tile) / GROUP_TILES);
}

/* What becomes of the radiosity that a point sends, by a gather's rays; returns the variance of what is lost of it,
 * times the samples. */
static double add_sent(const struct transport_state *s, uint64_t point, const struct kiln_point_result *r, double area,
                       struct kiln_exact_sum sums[SUM_COUNT])
{
    const double glass[3] = {(double)r->glass[0], (double)r->glass[1], (double)r->glass[2]};
    const double per_unit = 1.0 / s->unit;
    const double lost = fmin(1.0, (double)r->escaped + (double)r->blocked + kiln_luminance(glass));
    const bool all_arrives = !(lost > 0.0);
    float sent[3];
    double power[3];
    kiln_radiosity_unpack(s->out->radiosity[point], sent);
    for (int c = 0; c < 3; c++) {
        power[c] = area * (double)sent[c];
        kiln_exact_add(&sums[SUM_SENT + c], power[c], per_unit);
        if (all_arrives)
            continue;
        kiln_exact_add(&sums[SUM_ESCAPED + c], power[c] * (double)r->escaped, per_unit);
        kiln_exact_add(&sums[SUM_BLOCKED + c], power[c] * (double)r->blocked, per_unit);
        kiln_exact_add(&sums[SUM_GLASS + c], power[c] * glass[c], per_unit);
    }
    const double spread = kiln_luminance(power);
    return spread * spread * lost * (1.0 - lost);
}

static void add_energy(const struct pass_work *w, uint64_t own, const struct kiln_point_result *r,
                       const float albedo[3], struct kiln_exact_sum sums[SUM_COUNT], struct tile_run_sum *tile_run)
{
    const struct transport_state *s = w->state;
    const struct kiln_surface *surface = &w->share->surface;
    if (!kiln_point_valid(surface, own))
        return;
    const double area = (double)surface->area[own] * ((double)surface->visible[own] / 65535.0) * (double)r->present,
                 per_unit = 1.0 / s->unit;
    double reflected[3];
    for (int c = 0; c < 3; c++) {
        const double incident = area * (double)r->incident[c];
        reflected[c] = incident * (double)albedo[c];
        kiln_exact_add(&sums[SUM_INCIDENT + c], incident, per_unit);
        kiln_exact_add(&sums[SUM_REFLECTED + c], reflected[c], per_unit);
    }
    kiln_exact_add(&tile_run->reflected, kiln_luminance(reflected), per_unit);
    tile_run->variance += area * area * (double)r->error * (double)r->error;
    if (w->pass->kind != KILN_PASS_DIRECT)
        tile_run->variance += add_sent(s, surface->first + own, r, area, sums) / w->pass->samples;
}

/* Random bits for the 4-byte form: those of the tile, moved on for each texel by its bit reversed, so that every
 * aligned square of texels rounds up and down in turn, and its mean is kept much better than by chance (a rotated van
 * der Corput sequence). */
static uint32_t compact_hash(const struct transport_state *s, const struct kiln_tile_run *f, uint32_t bit)
{
    const uint32_t tile = kiln_hash2(transport_pack_hash(f, 0, s->step.stream), (uint32_t)s->params->job->seed);
    uint32_t reversed = 0;
    for (uint32_t i = 0; i < 6; i++)
        reversed |= (bit >> i & 1u) << (9 - i);
    return ((tile + reversed) & 1023u) | (((tile >> 10) + reversed) & 1023u) << 10 |
           (((tile >> 20) + reversed) & 1023u) << 20;
}

/* A texel's radiosity as it goes to the next bounce. */
static uint64_t packed(const struct transport_state *s, const struct kiln_tile_run *f, uint32_t bit,
                       const float radiosity[3])
{
    if (!s->compact)
        return kiln_radiosity_pack(radiosity, transport_pack_hash(f, bit, s->step.stream));
    float rounded[3];
    kiln_radiosity_expand(kiln_radiosity_compact(radiosity, s->scale, compact_hash(s, f, bit)), s->scale, rounded);
    return kiln_radiosity_pack(rounded, 0);
}

/* Takes over the answers of one tile run, `results` being those of its points. */
static void take_tile_run(const struct pass_work *w, const struct kiln_tile_run *tile_run,
                          const struct kiln_point_result *results, struct kiln_exact_sum sums[SUM_COUNT],
                          struct tile_run_sum *sum)
{
    struct transport_state *s = w->state;
    uint64_t own = tile_run->first - w->share->surface.first;
    /* what no ray meets takes no light from the scene */
    const bool counts =
        (s->params->backend->params.scene->objects[kiln_map_object(&w->share->surface, tile_run->map)].flags &
         KILN_OBJECT_RECEIVER_ONLY) == 0;
    *sum = (struct tile_run_sum){0};
    for (uint64_t rest = tile_run->mask; rest != 0; rest &= rest - 1, own++, results++) {
        float albedo[3], radiosity[3];
        transport_albedo(&w->share->surface, own, albedo);
        for (int c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * results->incident[c];
        if (counts)
            add_energy(w, own, results, albedo, sums, sum);
        s->step.take(w->share, own, results, radiosity);
        w->share->next[own] = packed(s, tile_run, (uint32_t)__builtin_ctzll(rest), radiosity);
    }
}

int transport_take_part(void *context, size_t first, size_t count, const void *part_results, struct kiln_error *error)
{
    struct pass_work *w = context;
    const struct kiln_point_result *results = part_results;
    struct transport_state *s = w->state;
    const struct kiln_transport_params *p = s->params;
    const struct kiln_surface *surface = &w->share->surface;
    const struct kiln_tile_run *tile_runs = surface->tile_runs + first;
    const double now = MPI_Wtime(), seconds = s->slowness * (now - w->since);
    w->since = now;
    const int status = kiln_grow(&w->tile_runs, &w->tile_run_room, count, sizeof *w->tile_runs, "a part's sums", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel num_threads((int)s->take_threads)
    {
        struct kiln_exact_sum own[SUM_COUNT] = {0};
#pragma omp for schedule(static)
        for (size_t i = 0; i < count; i++)
            take_tile_run(w, &tile_runs[i], results + (tile_runs[i].first - tile_runs[0].first), own, &w->tile_runs[i]);
#pragma omp critical(kiln_take_part)
        for (int k = 0; k < SUM_COUNT; k++) /* exact: the order of threads does not matter */
            s->sums[k].value += own[k].value;
    }
    const double cost =
        seconds / (double)(tile_runs[count - 1].first + tile_runs[count - 1].count - tile_runs[0].first);
    for (size_t i = 0; i < count; i++) {
        w->share->cost[first + i] = (float)(cost * (double)tile_runs[i].count);
        s->group_now[group_of(surface, &tile_runs[i])].value += w->tile_runs[i].reflected.value;
        kiln_exact_add(&s->variance, w->tile_runs[i].variance, 1.0 / s->unit_squared);
        w->points += tile_runs[i].count;
    }
    if (w->share != s->own)
        return KILN_OK;
    s->points_done += tile_runs[count - 1].first + tile_runs[count - 1].count - tile_runs[0].first;
    kiln_progress_advance(p->progress, s->points_done + kiln_work_queue_returned(s->own->queue));
    transport_send_done(s, first + count);
    return KILN_OK;
}

static void show_pass(const struct transport_state *s)
{
    char name[64];
    (void)snprintf(name, sizeof name, "bounce %u", s->step.bounce);
    const char *text = s->step.kind == KILN_PASS_DIRECT  ? "direct light"
                       : s->step.kind == KILN_PASS_FINAL ? "final gather"
                                                         : name;
    kiln_progress_phase(s->params->progress, text, s->params->surface->count);
    if (s->points_done > 0)
        kiln_progress_advance(s->params->progress, s->points_done);
    kiln_control_begin(s->params->control, text);
}

int transport_make_room(struct kiln_transport_report *report, size_t passes, struct kiln_error *error)
{
    return kiln_grow(&report->passes, &report->pass_room, passes, sizeof *report->passes, "the passes' report", error);
}

static int add_pass(struct transport_state *s, struct kiln_error *error)
{
    struct kiln_transport_report *report = &s->out->report;
    const int status = transport_make_room(report, report->pass_count + 1, error);
    if (status == KILN_OK)
        report->passes[report->pass_count++] =
            (struct kiln_pass_report){.kind = s->step.kind, .bounce = s->step.bounce, .samples = s->step.samples};
    return status;
}

int transport_pass_begin(struct transport_state *s, struct kiln_error *error)
{
    int status = add_pass(s, error);
    memset(s->sums, 0, sizeof s->sums);
    s->variance.value = 0;
    memset(s->group_now, 0, s->group_count * sizeof *s->group_now);
    s->points_done = 0;
    s->measured = true;
    s->todo_first = 0;
    s->todo_count = s->params->surface->tile_run_count > 0 ? 1 : 0;
    if (status == KILN_OK)
        status = kiln_grow(&s->todo, &s->todo_room, 1, sizeof *s->todo, "what a pass has to do", error);
    if (status == KILN_OK)
        s->todo[0] = (struct kiln_range){0, s->params->surface->tile_run_count};
    if (status == KILN_OK)
        transport_offer(s);
    kiln_control_meet(s->params->control);
    kiln_control_blocking(s->params->control, "between passes", 0.0);
    status = kiln_agree(s->params->communicator, status, error);
    kiln_control_blocking(s->params->control, NULL, 0.0);
    return status;
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
        pass->energy.glass[c] = kiln_exact_value(&sums[SUM_GLASS + c], s->unit);
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
    kiln_radiosity_allgather_begin(s->out->allgather);
    const double start = MPI_Wtime();
    int status = transport_run_batches(&w, error);
    if (status != KILN_OK)
        kiln_radiosity_allgather_abandon(s->out->allgather);
    w.pass->given += kiln_work_queue_returned(s->own->queue);
    kiln_trace_add(s->params->trace, KILN_TRACE_PASS, pass_names[s->step.kind], start, MPI_Wtime(),
                   (int64_t)s->params->surface->count);
    kiln_free(&w.tile_runs);
    kiln_control_blocking(s->params->control, "adding up a pass", 0.0);
    if (status == KILN_OK)
        status = close_pass(s, w.pass, error);
    kiln_control_blocking(s->params->control, NULL, 0.0);
    return status;
}
