#include "coordinator/bake/transport.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bake/exchange.h"
#include "coordinator/cli/agree.h"
#include "shaders/random.h"
#include "worker/base/memory.h"
#include "worker/scene/radiosity.h"

enum { FINAL_STREAM = 0xffff };

/* Sums that a pass makes over its points; by channel, then one for the variance. */
enum { SUM_INCIDENT = 0, SUM_REFLECTED = 3, SUM_SENT = 6, SUM_ESCAPED = 9, SUM_BLOCKED = 12, SUM_BEHIND = 15, SUM_BORROWED = 18, SUM_COUNT = 21 };

struct transport_state {
    const struct kiln_transport_params *params;
    struct kiln_transport *out;
    float *sum;      /* own: radiosity of all bounces so far, 3 a point; becomes out->indirect */
    uint64_t *next;  /* own: packed radiosity of the present bounce */
    double unit;     /* of the exact sums */
    /* reflected power, luminance, of groups of tiles: the present bounce's (all ranks' when the pass is over), the one's before,
     * and the sum of all; group_count each */
    size_t group_count;
    struct kiln_exact_sum *group_now;
    double *group_before, *group_total;
};

static double luminance(const double rgb[3]) { return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]; }

/* Rounding of a texel's radiosity: by what the texel is, never by where it stands in the global order. */
static uint32_t pack_hash(const struct kiln_fragment *f, uint32_t bit, uint32_t stream)
{
    return kiln_hash2(kiln_hash2(f->object, f->tile), stream * KILN_TILE_TEXELS + bit);
}

/* Packs three floats a point, `values`, of all own points into s->next. */
static void pack_all(struct transport_state *s, const float *values, uint32_t stream)
{
    const struct kiln_surface *surface = s->params->surface;
    for (size_t i = 0; i < surface->fragment_count; i++) {
        const struct kiln_fragment *f = &surface->fragments[i];
        uint64_t own = f->first - surface->first;
        for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own++)
            s->next[own] = kiln_radiosity_pack(&values[3 * own], pack_hash(f, (uint32_t)__builtin_ctzll(rest), stream));
    }
}

size_t kiln_transport_bytes(uint64_t own, uint64_t total)
{
    return (size_t)total * sizeof(uint64_t) + (size_t)own * (sizeof(uint64_t) + 6 * sizeof(float) + sizeof(uint16_t));
}

/* Groups are made of tiles, not of cells: the cell size must not change a result. */
enum { GROUP_TILES = 16 };

static size_t group_of(const struct kiln_surface *surface, const struct kiln_fragment *f)
{
    return (size_t)((surface->lightmaps[f->object].tile_first + f->tile) / GROUP_TILES);
}

/* What a pass does with a point's answer: gives the radiosity it has now. */
typedef void (*take_point)(struct transport_state *s, uint64_t own, const struct kiln_point_result *result, float radiosity[3]);

static void albedo_of(const struct kiln_surface *surface, uint64_t own, float albedo[3])
{
    for (int c = 0; c < 3; c++)
        albedo[c] = (float)surface->albedo[3 * own + (uint64_t)c] * (1.0f / 65535.0f);
}

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

/* What one fragment adds, kept apart until all are done: threads share the fragments, but tiles of one group meet. */
struct fragment_sum {
    struct kiln_exact_sum reflected; /* luminance */
    double variance;
};

/* A pass under way. */
struct pass_work {
    struct transport_state *state;
    struct kiln_pass_report *pass;
    uint32_t stream;
    take_point take;
    struct kiln_exact_sum sums[SUM_COUNT];
    double variance;
    struct fragment_sum *fragments; /* of the part being taken */
    size_t fragment_room;
};

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
    albedo_of(surface, own, albedo);
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
    kiln_exact_add(&fragment->reflected, luminance(reflected), s->unit);
    const double lost = fmin(1.0, (double)r->escaped + (double)r->blocked + (double)r->behind), spread = luminance(power);
    fragment->variance += area * area * (double)r->error * (double)r->error +
                          (gather ? spread * spread * lost * (1.0 - lost) / w->pass->samples : 0.0);
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
        albedo_of(s->params->surface, own, albedo);
        for (int c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * results->incident[c];
        add_energy(w, own, results, sums, sum);
        w->take(s, own, results, radiosity);
        s->next[own] = kiln_radiosity_pack(radiosity, pack_hash(fragment, (uint32_t)__builtin_ctzll(rest), w->stream));
    }
}

/* kiln_take_results of all passes. */
static int take_part(void *context, size_t first, size_t count, const struct kiln_point_result *results, struct kiln_error *error)
{
    struct pass_work *w = context;
    const struct kiln_transport_params *p = w->state->params;
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
            w->sums[k].value += own[k].value;
    }
    for (size_t i = 0; i < count; i++) {
        w->state->group_now[group_of(p->surface, &fragments[i])].value += w->fragments[i].reflected.value;
        w->variance += w->fragments[i].variance;
    }
    const struct kiln_fragment *last = &fragments[count - 1];
    kiln_progress_advance(p->progress, last->first + last->count - p->surface->first);
    return *p->stop != 0 ? kiln_fail(error, KILN_STOPPED, "stopped by a signal; no result was written") : KILN_OK;
}

/* One pass over all own points; `pass` gets this rank's time and the energies of all ranks. */
static int run_pass(struct transport_state *s, struct kiln_pass_report *pass, uint32_t stream, take_point take, struct kiln_error *error)
{
    const struct kiln_transport_params *p = s->params;
    const bool gather = pass->kind != KILN_PASS_DIRECT;
    struct pass_work w = {.state = s, .pass = pass, .stream = stream, .take = take};
    const struct kiln_batch batch = {0, p->surface->fragment_count, take_part, &w};
    memset(s->group_now, 0, s->group_count * sizeof *s->group_now);
    const double start = MPI_Wtime();
    int status = gather ? kiln_backend_set_radiosity(p->backend, s->out->radiosity, error) : KILN_OK;
    if (status == KILN_OK)
        status = gather ? kiln_backend_gather(p->backend, &batch, pass->samples, stream, &pass->rays, error)
                        : kiln_backend_direct(p->backend, &batch, pass->samples, &pass->rays, error);
    kiln_free(&w.fragments);
    pass->seconds = MPI_Wtime() - start;
    status = kiln_agree(p->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_exact_reduce(p->communicator, w.sums, SUM_COUNT, error);
    (void)MPI_Allreduce(MPI_IN_PLACE, &w.variance, 1, MPI_DOUBLE, MPI_SUM, p->communicator);
    for (int c = 0; c < 3; c++) {
        pass->energy.incident[c] = kiln_exact_value(&w.sums[SUM_INCIDENT + c], s->unit);
        pass->energy.reflected[c] = kiln_exact_value(&w.sums[SUM_REFLECTED + c], s->unit);
        pass->energy.sent[c] = kiln_exact_value(&w.sums[SUM_SENT + c], s->unit);
        pass->energy.escaped[c] = kiln_exact_value(&w.sums[SUM_ESCAPED + c], s->unit);
        pass->energy.blocked[c] = kiln_exact_value(&w.sums[SUM_BLOCKED + c], s->unit);
        pass->energy.behind[c] = kiln_exact_value(&w.sums[SUM_BEHIND + c], s->unit);
        pass->energy.borrowed[c] = kiln_exact_value(&w.sums[SUM_BORROWED + c], s->unit);
    }
    pass->energy.variance = w.variance;
    return status;
}

static int exchange(struct transport_state *s, struct kiln_pass_report *pass, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->params->surface;
    const double start = MPI_Wtime();
    memcpy(s->out->radiosity + surface->first, s->next, surface->count * sizeof *s->next);
    const int status = kiln_exchange(s->params->communicator, s->out->radiosity, surface->point_count, surface->first, surface->count, error);
    pass->exchange_seconds += MPI_Wtime() - start;
    return status;
}

static struct kiln_pass_report *new_pass(struct transport_state *s, enum kiln_pass_kind kind, uint32_t bounce, uint32_t samples)
{
    struct kiln_transport_report *report = &s->out->report;
    struct kiln_pass_report *pass = &report->passes[report->pass_count++];
    *pass = (struct kiln_pass_report){.kind = kind, .bounce = bounce, .samples = samples};
    char name[64];
    if (kind == KILN_PASS_BOUNCE)
        (void)snprintf(name, sizeof name, "bounce %u", bounce);
    kiln_progress_phase(s->params->progress, kind == KILN_PASS_DIRECT ? "direct light" : kind == KILN_PASS_FINAL ? "final gather" : name,
                        s->params->surface->count);
    return pass;
}

/* Reflected power of the passes so far (direct and bounces), and the ratio of the last two, luminance. */
static double ratio_of(const struct kiln_transport_report *r, size_t pass)
{
    const double before = luminance(r->passes[pass - 1].energy.reflected);
    return before > 0.0 ? luminance(r->passes[pass].energy.reflected) / before : 0.0;
}

/* Adds up the groups' powers over ranks; `before` and `total` move on by one bounce. Gives the root mean square over groups of
 * the error that a geometric series of ratio q would make from this bounce on, relative to what the group reflects in all: light
 * that reaches a room through a door comes later than elsewhere, and only there the last two bounces show it. Groups much
 * darker than the mean count for less. Collective. */
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

/* Whether a geometric series from the last pass on is good enough: two parts in a thousand. `bounces` passes after the direct one
 * are done. Collective. */
static int settled(struct transport_state *s, size_t bounces, bool *done, struct kiln_error *error)
{
    const struct kiln_transport_report *r = &s->out->report;
    const double last = luminance(r->passes[bounces].energy.reflected), ratio = bounces > 0 ? ratio_of(r, bounces) : 1.0;
    double total = 0.0, off = 0.0;
    for (size_t i = 0; i <= bounces; i++)
        total += luminance(r->passes[i].energy.reflected);
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
        const double last = r->passes[bounces].energy.reflected[c], before = bounces > 0 ? r->passes[bounces - 1].energy.reflected[c] : 0.0;
        const double ratio = before > 0.0 ? fmin(last / before, 0.9999) : 0.0;
        r->tail_ratio[c] = ratio;
        factor[c] = (float)(ratio / (1.0 - ratio));
        tail[c] = last * ratio / (1.0 - ratio);
        for (size_t i = 0; i <= bounces; i++)
            total[c] += r->passes[i].energy.reflected[c];
        total[c] += tail[c];
    }
    r->tail = true;
    r->tail_share = luminance(total) > 0.0 ? luminance(tail) / luminance(total) : 0.0;
    for (uint64_t i = 0; i < s->params->surface->count; i++) {
        float last[3];
        kiln_radiosity_unpack(s->next[i], last);
        for (uint64_t c = 0; c < 3; c++)
            s->sum[3 * i + c] += factor[c] * last[c];
    }
}

/* Whether another bounce comes before the final gather: bounces - 1 of them when their number is given. Collective. */
static int more_bounces(struct transport_state *s, size_t done, bool *more, struct kiln_error *error)
{
    const int64_t wanted = s->params->job->bounces;
    bool enough = false;
    const int status = wanted < 0 ? settled(s, done, &enough, error) : KILN_OK;
    *more = wanted >= 0 ? (int64_t)done + 1 < wanted : done < KILN_BOUNCES_MAX - 2 && !enough;
    return status;
}

static int run_lean(struct transport_state *s, struct kiln_error *error)
{
    const struct kiln_job *job = s->params->job;
    struct kiln_transport_report *report = &s->out->report;
    uint32_t done = 0;
    bool more = false;
    int status = more_bounces(s, done, &more, error);
    while (status == KILN_OK && more) {
        status = exchange(s, &report->passes[done], error);
        if (status != KILN_OK)
            return status;
        struct kiln_pass_report *pass = new_pass(s, KILN_PASS_BOUNCE, ++done, job->samples_bounce);
        status = run_pass(s, pass, done, take_bounce, error);
        if (status == KILN_OK)
            status = more_bounces(s, done, &more, error);
    }
    if (status != KILN_OK || job->bounces == 0)
        return status;
    if (job->tail || job->bounces < 0)
        add_tail(s, done);
    pack_all(s, s->sum, FINAL_STREAM);
    status = exchange(s, &report->passes[done], error);
    report->bounces = done + 1;
    if (status == KILN_OK)
        status = run_pass(s, new_pass(s, KILN_PASS_FINAL, done + 1, job->samples_indirect), FINAL_STREAM, take_final, error);
    return status;
}

static int run_equal(struct transport_state *s, struct kiln_error *error)
{
    const struct kiln_job *job = s->params->job;
    struct kiln_transport_report *report = &s->out->report;
    const int64_t most = job->bounces >= 0 && job->bounces < KILN_BOUNCES_MAX - 1 ? job->bounces : KILN_BOUNCES_MAX - 2;
    int status = KILN_OK;
    memset(s->sum, 0, 3 * s->params->surface->count * sizeof *s->sum);
    for (uint32_t b = 1; b <= most && status == KILN_OK; b++) {
        if (job->bounces < 0 && b > 1) { /* without a tail: until what is left is below 1e-5 of all */
            double total = 0.0;
            for (uint32_t i = 0; i < b; i++)
                total += luminance(report->passes[i].energy.reflected);
            if (luminance(report->passes[b - 1].energy.reflected) <= 1e-5 * total)
                break;
        }
        status = exchange(s, &report->passes[b - 1], error);
        if (status == KILN_OK)
            status = run_pass(s, new_pass(s, KILN_PASS_BOUNCE, b, job->samples_indirect), b, take_equal, error);
        report->bounces = b;
    }
    return status;
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
        e->behind[c] = light->behind[c];
        e->ranged[c] = light->ranged[c];
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
            e->behind[c] += p->energy.behind[c];
            e->borrowed[c] += p->energy.borrowed[c];
            e->left_over[c] += p->energy.reflected[c] - p->energy.sent[c];
        }
        variance += p->energy.variance;
    }
    double residual[3];
    for (int c = 0; c < 3; c++)
        residual[c] = e->emitted[c] + e->borrowed[c] - e->absorbed[c] - e->escaped[c] - e->blocked[c] - e->behind[c] - e->ranged[c] -
                      e->left_over[c];
    e->residual = luminance(residual);
    e->error = sqrt(variance + luminance(emission_error) * luminance(emission_error));
    const double emitted = luminance(e->emitted);
    e->relative = emitted > 0.0 ? fabs(e->residual) / emitted : 0.0;
}

/* Total radiosity of all points, for probes and views. */
static int publish_radiosity(struct transport_state *s, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->params->surface;
    const uint32_t stream = FINAL_STREAM + 1;
    for (size_t i = 0; i < surface->fragment_count; i++) {
        const struct kiln_fragment *f = &surface->fragments[i];
        uint64_t own = f->first - surface->first;
        for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own++) {
            float albedo[3], total[3];
            albedo_of(surface, own, albedo);
            for (uint64_t c = 0; c < 3; c++)
                total[c] = albedo[c] * (s->out->direct[3 * own + c] + s->out->indirect[3 * own + c]);
            s->next[own] = kiln_radiosity_pack(total, pack_hash(f, (uint32_t)__builtin_ctzll(rest), stream));
        }
    }
    struct kiln_transport_report *r = &s->out->report;
    return exchange(s, &r->passes[r->pass_count - 1], error);
}

static int allocate(struct transport_state *s, struct kiln_error *error)
{
    const struct kiln_surface *surface = s->params->surface;
    struct kiln_transport *t = s->out;
    int status = kiln_allocate(&t->direct, 3 * surface->count, sizeof(float), "direct irradiance", error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->indirect, 3 * surface->count, sizeof(float), "indirect irradiance", error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->error, surface->count, sizeof *t->error, "standard errors", error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->radiosity, surface->point_count, sizeof(uint64_t), "the radiosity of all points", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->next, surface->count, sizeof(uint64_t), "the radiosity of a bounce", error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->report.passes, KILN_BOUNCES_MAX + 2, sizeof *t->report.passes, "the passes' report", error);
    s->group_count = (size_t)(surface->tile_count / GROUP_TILES) + 1;
    if (status == KILN_OK)
        status = kiln_allocate(&s->group_now, s->group_count, sizeof *s->group_now, "the groups' powers", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->group_before, s->group_count, sizeof *s->group_before, "the groups' powers", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->group_total, s->group_count, sizeof *s->group_total, "the groups' powers", error);
    s->sum = t->indirect;
    return status;
}

int kiln_transport_run(struct kiln_transport **transport, const struct kiln_transport_params *params, struct kiln_error *error)
{
    struct transport_state s = {.params = params};
    *transport = NULL;
    int status = kiln_allocate(&s.out, 1, sizeof *s.out, "the transport", error);
    if (status == KILN_OK)
        status = allocate(&s, error);
    s.unit = kiln_exact_unit(luminance(params->emission->emitted));
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = run_pass(&s, new_pass(&s, KILN_PASS_DIRECT, 0, params->job->samples_direct), 0, take_direct, error);
    if (status == KILN_OK)
        status = params->job->schedule == KILN_SCHEDULE_EQUAL ? run_equal(&s, error) : run_lean(&s, error);
    if (status == KILN_OK && params->job->bounces == 0)
        memset(s.out->indirect, 0, 3 * params->surface->count * sizeof *s.out->indirect);
    if (status == KILN_OK)
        status = publish_radiosity(&s, error);
    if (status == KILN_OK)
        close_ledger(&s);
    kiln_free(&s.next);
    kiln_free(&s.group_now);
    kiln_free(&s.group_before);
    kiln_free(&s.group_total);
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
    kiln_free(&t->direct);
    kiln_free(&t->indirect);
    kiln_free(&t->error);
    kiln_free(&t->radiosity);
    kiln_free(&t->report.passes);
    kiln_free(transport);
}
