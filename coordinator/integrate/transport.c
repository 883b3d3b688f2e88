#include "coordinator/integrate/transport.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/integrate/repartition.h"
#include "coordinator/integrate/transport_private.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"
#include "worker/scene/radiosity.h"

#define LONG_TAIL_RATIO 0.8 /* of a bounce to the one before */
#define EXCHANGE_BYTES 10e6 /* a second, at the slowest network that is not taken for a dead one */

/* Rounding of a texel's radiosity: by what the texel is, never by where it stands in the global order. */
/* Packs three floats a point, `values`, of all own points into s->own->next. */
static void pack_all(struct transport_state *s, const float *values, uint32_t stream)
{
    const struct kiln_surface *surface = s->params->surface;
    for (size_t i = 0; i < surface->tile_run_count; i++) {
        const struct kiln_tile_run *f = &surface->tile_runs[i];
        uint64_t own = f->first - surface->first;
        for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own++)
            s->own->next[own] =
                kiln_radiosity_pack(&values[3 * own], transport_pack_hash(f, (uint32_t)__builtin_ctzll(rest), stream));
    }
}

size_t kiln_transport_bytes(uint64_t own, uint64_t total)
{
    return (size_t)total * sizeof(uint64_t) + (size_t)own * (sizeof(uint64_t) + 6 * sizeof(float) + sizeof(uint16_t));
}

/* Reflected power of the passes so far (direct and bounces), and the ratio of the last two, luminance. */
static double ratio_of(const struct kiln_transport_report *r, size_t pass)
{
    const double before = kiln_luminance(r->passes[pass - 1].energy.reflected);
    return before > 0.0 ? kiln_luminance(r->passes[pass].energy.reflected) / before : 0.0;
}

/* A tail multiplies the rounding of the last bounces by 1 / (1 - ratio): in a furnace that costs more than 4 bytes a
 * point are worth. */
static bool tail_is_long(const struct transport_state *s)
{
    const struct kiln_job *job = s->params->job;
    const size_t done = s->out->report.pass_count - 1;
    return (job->tail || job->bounces < 0) && done >= 2 && ratio_of(&s->out->report, done - 1) > LONG_TAIL_RATIO;
}

void transport_choose_form(struct transport_state *s)
{
    const struct kiln_job *job = s->params->job;
    const int64_t done = (int64_t)s->out->report.pass_count;
    const bool small = kiln_exchange_is_compact(job->exchange, s->params->surface->point_count);
    s->compact = job->schedule == KILN_SCHEDULE_LEAN && s->step.kind != KILN_PASS_FINAL && small && !tail_is_long(s);
    s->early = s->compact && (job->bounces < 0 || done < job->bounces);
}

enum exchange_form { EXCHANGE_OWN, EXCHANGE_FULL, EXCHANGE_COMPACT };

/* Everybody gets everybody's radiosity: what is in place of this rank's in out->radiosity, or s->own->next, in 8 bytes
 * or in 4. Collective. */
static void exchange(struct transport_state *s, struct kiln_pass_report *pass, enum exchange_form form)
{
    const struct kiln_surface *surface = s->params->surface;
    const double start = MPI_Wtime();
    kiln_control_meet(s->params->control);
    kiln_control_blocking(s->params->control, "exchange", (double)surface->point_count * 8.0 / EXCHANGE_BYTES);
    if (form != EXCHANGE_COMPACT)
        kiln_radiosity_allgather_abandon(s->out->allgather);
    if (form == EXCHANGE_FULL)
        memcpy(s->out->radiosity + surface->first, s->own->next, surface->count * sizeof *s->own->next);
    if (form == EXCHANGE_COMPACT)
        kiln_radiosity_allgather_finish(s->out->allgather, s->own->next);
    else
        kiln_radiosity_allgather_all(s->out->allgather);
    kiln_control_blocking(s->params->control, NULL, 0.0);
    const double end = MPI_Wtime();
    pass->exchange_seconds += end - start;
    kiln_trace_add(s->params->trace, KILN_TRACE_EXCHANGE, form == EXCHANGE_COMPACT ? "end of exchange" : "exchange",
                   start, end, (int64_t)surface->count);
}

/* Adds up the groups' powers over ranks; `before` and `total` move on by one bounce. Gives the root mean square over
 * groups of the error that a geometric series of ratio q would make from this bounce on, relative to what the group
 * reflects in all: light that reaches a room through a door comes later than elsewhere, and only there the last two
 * bounces show it. Groups much darker than the mean count for less. Collective. */
static int tail_error(struct transport_state *s, double q, double *error_of_tail, struct kiln_error *error)
{
    int status = kiln_exact_reduce(s->params->communicator, s->group_now, s->group_count, error);
    double mean = 0.0, square = 0.0;
    size_t lit = 0;
    for (size_t i = 0; i < s->group_count; i++) {
        s->group_total[i] += kiln_exact_value(&s->group_now[i], s->unit);
        mean += s->group_total[i];
        lit += s->group_total[i] > 0.0;
    }
    mean = lit > 0 ? mean / (double)lit : 0.0;
    for (size_t i = 0; i < s->group_count; i++) {
        const double now = kiln_exact_value(&s->group_now[i], s->unit);
        const double off = fabs(now - q * s->group_before[i]) / (1.0 - q);
        const double all = s->group_total[i] + now * q / (1.0 - q) + 1e-3 * mean;
        if (s->group_total[i] > 0.0 && all > 0.0)
            square += off / all * (off / all);
        s->group_before[i] = now;
    }
    *error_of_tail = lit > 0 ? sqrt(square / (double)lit) : 0.0;
    return status;
}

/* Whether a geometric series from the last pass on is good enough: two parts in a thousand. `bounces` passes after the
 * direct one are done. Collective. */
static int settled(struct transport_state *s, size_t bounces, bool *done, struct kiln_error *error)
{
    const struct kiln_transport_report *r = &s->out->report;
    const double last = kiln_luminance(r->passes[bounces].energy.reflected),
                 ratio = bounces > 0 ? ratio_of(r, bounces) : 1.0;
    double total = 0.0, off = 0.0;
    for (size_t i = 0; i <= bounces; i++)
        total += kiln_luminance(r->passes[i].energy.reflected);
    const int status = tail_error(s, fmin(ratio, 0.9999), &off, error);
    *done = !(last > 1e-7 * total) || (bounces >= 3 && ratio < 0.9999 && off <= 2e-3);
    return status;
}

/* Adds the tail to the sum: the last bounce's radiosity times q + q^2 + ... for each channel's own ratio q. */
static void add_tail(struct transport_state *s, size_t bounces)
{
    struct kiln_transport_report *r = &s->out->report;
    float factor[3] = {0};
    double tail[3], total[3] = {0};
    for (int c = 0; c < 3; c++) {
        const double last = r->passes[bounces].energy.reflected[c],
                     before = bounces > 0 ? r->passes[bounces - 1].energy.reflected[c] : 0.0;
        const double ratio = before > 0.0 ? fmin(last / before, 0.9999) : 0.0;
        r->tail_ratio[c] = ratio;
        factor[c] = (float)(ratio / (1.0 - ratio));
        tail[c] = last * ratio / (1.0 - ratio);
        for (size_t i = 0; i <= bounces; i++)
            total[c] += r->passes[i].energy.reflected[c];
        total[c] += tail[c];
    }
    r->tail = true;
    r->tail_share = kiln_luminance(total) > 0.0 ? kiln_luminance(tail) / kiln_luminance(total) : 0.0;
    for (uint64_t i = 0; i < s->params->surface->count; i++) {
        float last[3];
        kiln_radiosity_unpack(s->own->next[i], last);
        for (uint64_t c = 0; c < 3; c++)
            s->own->sum[3 * i + c] += factor[c] * last[c];
    }
}

/* Whether another bounce comes before the final gather: bounces - 1 of them when their number is given. Collective. */
static int more_bounces(struct transport_state *s, size_t done, bool *more, struct kiln_error *error)
{
    const int64_t wanted = s->params->job->bounces;
    bool enough = false;
    const int status = wanted < 0 ? settled(s, done, &enough, error) : KILN_OK;
    *more = wanted >= 0 ? (int64_t)done + 1 < wanted : done < KILN_BOUNCES_ALL && !enough;
    return status;
}

/* What comes after the passes so far; false: nothing. Collective. */
static int next_lean(struct transport_state *s, struct transport_step *step, bool *any, struct kiln_error *error)
{
    const struct kiln_transport_report *report = &s->out->report;
    const uint32_t done = (uint32_t)report->pass_count - 1;
    bool more = false;
    const bool last = report->passes[done].kind == KILN_PASS_FINAL;
    const int status = last ? KILN_OK : more_bounces(s, done, &more, error);
    *any = !last && s->params->job->bounces != 0;
    transport_step_make(s, more ? KILN_PASS_BOUNCE : KILN_PASS_FINAL, done + 1, step);
    return status;
}

static bool next_equal(const struct transport_state *s, struct transport_step *step)
{
    const struct kiln_job *job = s->params->job;
    const struct kiln_transport_report *report = &s->out->report;
    const int64_t most = job->bounces >= 0 ? job->bounces : KILN_BOUNCES_ALL;
    const uint32_t bounce = (uint32_t)report->pass_count;
    transport_step_make(s, KILN_PASS_BOUNCE, bounce, step);
    if (job->bounces < 0 && bounce > 1) { /* without a tail: until what is left is below 1e-5 of all */
        double total = 0.0;
        for (uint32_t i = 0; i < bounce; i++)
            total += kiln_luminance(report->passes[i].energy.reflected);
        if (kiln_luminance(report->passes[bounce - 1].energy.reflected) <= 1e-5 * total)
            return false;
    }
    return bounce <= most;
}

static int next_step(struct transport_state *s, bool *any, struct kiln_error *error)
{
    *any = true;
    if (s->out->report.pass_count == 0) {
        transport_step_make(s, KILN_PASS_DIRECT, 0, &s->step);
        return KILN_OK;
    }
    struct transport_step step;
    int status = KILN_OK;
    if (s->params->job->schedule == KILN_SCHEDULE_EQUAL)
        *any = next_equal(s, &step);
    else
        status = next_lean(s, &step, any, error);
    if (status == KILN_OK && *any)
        s->step = step;
    return status;
}

/* Everybody gets the radiosity that s->step gathers from. Collective. */
static void hand_over(struct transport_state *s)
{
    struct kiln_transport_report *report = &s->out->report;
    const struct kiln_job *job = s->params->job;
    if (s->step.kind == KILN_PASS_DIRECT)
        return;
    struct kiln_pass_report *before = &report->passes[report->pass_count - 1];
    if (job->schedule == KILN_SCHEDULE_EQUAL) {
        if (s->step.bounce == 1) /* the sum is of irradiance now, and of bounces only */
            memset(s->own->sum, 0, 3 * s->params->surface->count * sizeof *s->own->sum);
        report->bounces = s->step.bounce;
    } else if (s->step.kind == KILN_PASS_FINAL) {
        if (job->tail || job->bounces < 0)
            add_tail(s, report->pass_count - 1);
        pack_all(s, s->own->sum, FINAL_STREAM);
        report->bounces = s->step.bounce;
    }
    exchange(s, before, s->compact && s->step.kind == KILN_PASS_BOUNCE ? EXCHANGE_COMPACT : EXCHANGE_FULL);
}

/* At the begin of a pass, and after the last: a checkpoint when one is due, the end when that is asked for. Collective.
 */
static int save_between(struct transport_state *s, bool finished, struct kiln_error *error)
{
    switch (kiln_control_between(s->params->control, transport_save_bytes(s))) {
    case KILN_EVENT_SAVE:
        return transport_save(s, finished, error);
    case KILN_EVENT_STOP:
        return transport_stop(s, finished, error);
    case KILN_EVENT_NONE:
    case KILN_EVENT_FAIL:
    case KILN_EVENT_DONE:
        break;
    }
    return KILN_OK;
}

/* Pass after pass; `finished` and the first pass's state are from a checkpoint when there is one. Collective. */
static int run_passes(struct transport_state *s, bool restored, bool finished, struct kiln_error *error)
{
    int status = KILN_OK;
    if (restored && !finished) {
        if (s->step.kind != KILN_PASS_DIRECT)
            exchange(s, &s->out->report.passes[s->out->report.pass_count - 1], EXCHANGE_OWN);
        status = transport_pass_run(s, error);
    }
    for (bool any = !finished; status == KILN_OK && any;) {
        kiln_control_blocking(s->params->control, "between passes", 0.0);
        status = next_step(s, &any, error);
        kiln_control_blocking(s->params->control, NULL, 0.0);
        if (status != KILN_OK || !any)
            break;
        hand_over(s);
        if (s->step.kind != KILN_PASS_DIRECT)
            status = transport_rebalance(s, error);
        if (status == KILN_OK)
            status = transport_pass_begin(s, error);
        if (status == KILN_OK && s->step.kind != KILN_PASS_DIRECT)
            status = save_between(s, false, error);
        if (status == KILN_OK)
            status = transport_pass_run(s, error);
    }
    return status != KILN_OK || finished ? status : save_between(s, true, error);
}

/* Closes the ledger: see energy.h. In the lean schedule only the final gather counts, in the equal one every bounce. */
static void close_ledger(struct transport_state *s)
{
    const struct kiln_transport_report *r = &s->out->report;
    const struct kiln_emission_result *light = s->params->emission;
    struct kiln_energy *e = &s->out->report.energy;
    double variance = r->passes[0].energy.variance, emission_error[3];
    for (int c = 0; c < 3; c++) {
        e->emitted[c] = light->emitted[c];
        e->escaped[c] = light->escaped[c];
        e->blocked[c] = light->blocked[c];
        e->ranged[c] = light->ranged[c];
        e->glass[c] = light->glass[c];
        e->absorbed[c] = r->passes[0].energy.incident[c] - r->passes[0].energy.reflected[c];
        e->left_over[c] = r->passes[0].energy.reflected[c];
        emission_error[c] = light->error[c];
    }
    for (size_t i = 1; i < r->pass_count; i++) {
        const struct kiln_pass_report *p = &r->passes[i];
        if (s->params->job->schedule == KILN_SCHEDULE_LEAN && p->kind != KILN_PASS_FINAL)
            continue;
        for (int c = 0; c < 3; c++) {
            e->absorbed[c] += p->energy.incident[c] - p->energy.reflected[c];
            e->escaped[c] += p->energy.escaped[c];
            e->blocked[c] += p->energy.blocked[c];
            e->glass[c] += p->energy.glass[c];
            e->left_over[c] += p->energy.reflected[c] - p->energy.sent[c];
        }
        variance += p->energy.variance;
    }
    double residual[3];
    for (int c = 0; c < 3; c++)
        residual[c] = e->emitted[c] - e->absorbed[c] - e->escaped[c] - e->blocked[c] - e->ranged[c] - e->glass[c] -
                      e->left_over[c];
    e->residual = kiln_luminance(residual);
    e->error = sqrt(variance + kiln_luminance(emission_error) * kiln_luminance(emission_error));
    const double emitted = kiln_luminance(e->emitted);
    e->relative = emitted > 0.0 ? fabs(e->residual) / emitted : 0.0;
}

/* Total radiosity of all points, for probes and views. */
static void publish_radiosity(struct transport_state *s)
{
    const struct kiln_surface *surface = s->params->surface;
    const uint32_t stream = FINAL_STREAM + 1;
    for (size_t i = 0; i < surface->tile_run_count; i++) {
        const struct kiln_tile_run *f = &surface->tile_runs[i];
        uint64_t own = f->first - surface->first;
        for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own++) {
            float albedo[3], total[3];
            transport_albedo(surface, own, albedo);
            for (uint64_t c = 0; c < 3; c++)
                total[c] = albedo[c] * (s->out->direct[3 * own + c] + s->out->indirect[3 * own + c]);
            s->own->next[own] =
                kiln_radiosity_pack(total, transport_pack_hash(f, (uint32_t)__builtin_ctzll(rest), stream));
        }
    }
    struct kiln_transport_report *r = &s->out->report;
    exchange(s, &r->passes[r->pass_count - 1], EXCHANGE_FULL);
}

static int allocate(struct transport_state *s, struct kiln_error *error)
{
    s->group_count = (size_t)(s->params->surface->tile_count / GROUP_TILES) + 1;
    int status = kiln_allocate(&s->group_now, s->group_count, sizeof *s->group_now, "the groups' powers", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->group_before, s->group_count, sizeof *s->group_before, "the groups' powers", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->group_total, s->group_count, sizeof *s->group_total, "the groups' powers", error);
    return status;
}

static bool can_share(const struct kiln_transport_params *p)
{
    struct kiln_backend_info info;
    kiln_backend_info(p->backend, &info);
    return info.any_share;
}

static uint32_t take_threads(const struct kiln_transport_params *p)
{
    struct kiln_backend_info info;
    kiln_backend_info(p->backend, &info);
    return info.take_threads != 0 && info.take_threads < p->threads ? info.take_threads : p->threads;
}

/* Whether the ranks of this node give work away: all of them want to and can. Collective on the node. */
static bool steals_work(const struct kiln_transport_params *p)
{
    int gives = p->job->work_stealing && can_share(p);
    (void)MPI_Allreduce(MPI_IN_PLACE, &gives, 1, MPI_INT, MPI_LAND, kiln_node_communicator(p->node));
    return gives != 0;
}

void transport_use_shares(struct transport_state *s)
{
    struct kiln_transport *t = s->out;
    s->own = kiln_rank_data(t->node_data, kiln_node_data_own(t->node_data));
    t->direct = s->own->direct;
    t->indirect = s->own->sum;
    t->error = s->own->error;
    t->report.steals_work = kiln_node_data_count(t->node_data) > 1;
}

/* Collective. */
static int make_shares(struct transport_state *s, struct kiln_error *error)
{
    const struct kiln_transport_params *p = s->params;
    int status = kiln_node_data_create(&s->out->node_data, p->node, p->surface, steals_work(p), error);
    if (status == KILN_OK) {
        transport_use_shares(s);
        /* its arrays have moved; a device, whose ranks lend nothing, keeps what it has of them */
        if (p->surface->share_is_lent)
            status = kiln_backend_set_surface(p->backend, p->surface, error);
    }
    int any_share = can_share(p);
    (void)MPI_Allreduce(MPI_IN_PLACE, &any_share, 1, MPI_INT, MPI_LAND, p->communicator);
    s->cuts_anew = kiln_repartition_is_allowed(p->job, any_share != 0);
    return kiln_agree(p->communicator, status, error);
}

/* The scale is settled by what was emitted, as it stands in the unit of the sums: that one is kept in checkpoints. */
static void choose_scale(struct transport_state *s)
{
    const double power = ldexp(s->unit, 82), area = s->params->area > 0.0 ? s->params->area : 1.0;
    s->scale = ldexp(1.0, ilogb(power / area));
    kiln_radiosity_allgather_set_scale(s->out->allgather, s->scale);
}

/* Collective. */
static int make_spread(struct transport_state *s, struct kiln_error *error)
{
    const struct kiln_transport_params *p = s->params;
    const struct kiln_radiosity_allgather_params params = {.communicator = p->communicator,
                                                           .node = p->node,
                                                           .total = p->surface->point_count,
                                                           .first = p->surface->first,
                                                           .count = p->surface->count,
                                                           .trace = p->trace,
                                                           .threads = p->threads,
                                                           .limit = p->job->exchange_limit};
    const int status = kiln_radiosity_allgather_create(&s->out->allgather, &params, error);
    if (status == KILN_OK)
        s->out->radiosity = kiln_radiosity_allgather_values(s->out->allgather);
    return status;
}

int kiln_transport_run(struct kiln_transport **transport, const struct kiln_transport_params *params,
                       struct kiln_error *error)
{
    struct transport_state s = {.params = params, .take_threads = take_threads(params)};
    const double emitted = kiln_luminance(params->emission->emitted);
    const bool restored = kiln_checkpoint_generation(params->checkpoint) != 0;
    bool finished = false;
    *transport = NULL;
    int status = kiln_allocate(&s.out, 1, sizeof *s.out, "the transport", error);
    if (status == KILN_OK)
        status = allocate(&s, error);
    s.unit = kiln_exact_unit(emitted);
    s.unit_squared = kiln_exact_unit(emitted * emitted);
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = make_spread(&s, error);
    if (status == KILN_OK) /* after the radiosity: that is the node's most useful block */
        status = make_shares(&s, error);
    if (status == KILN_OK)
        status = kiln_agree(params->communicator, transport_read_slowness(&s, error), error);
    if (status == KILN_OK && restored)
        status = transport_restore(&s, &finished, error);
    if (status == KILN_OK) {
        choose_scale(&s);
        status = run_passes(&s, restored, finished, error);
    }
    if (status == KILN_OK && params->job->bounces == 0)
        memset(s.out->indirect, 0, 3 * params->surface->count * sizeof *s.out->indirect);
    if (status == KILN_OK) {
        publish_radiosity(&s);
        close_ledger(&s);
        s.out->report.received = kiln_radiosity_allgather_received(s.out->allgather);
    }
    if (s.out != NULL && s.out->node_data != NULL)
        kiln_node_data_end(s.out->node_data);
    kiln_free(&s.group_now);
    kiln_free(&s.group_before);
    kiln_free(&s.group_total);
    kiln_free(&s.todo);
    *transport = s.out;
    if (status != KILN_OK)
        kiln_transport_destroy(transport);
    return status;
}

void kiln_transport_destroy(struct kiln_transport **transport)
{
    struct kiln_transport *t = *transport;
    if (t == NULL)
        return;
    kiln_node_data_destroy(&t->node_data);
    kiln_radiosity_allgather_destroy(&t->allgather);
    kiln_free(&t->report.passes);
    kiln_free(transport);
}
