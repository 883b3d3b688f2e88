#include "coordinator/bake/reckon/reckon.h"

#include <math.h>
#include <string.h>

#include "coordinator/bake/reckon/rates.h"

enum { FIRST_DOUBLINGS = 5, DENSEST = 4 };
enum { JUDGED_MOST = 1 << 15 }; /* points that are denoised to judge a round (bake/light/denoised_sample.h) */
#define PREVIEW_OF_GLOSS 2.7    /* rays of a pixel that sees gloss, over others */

#define KILN_RECKON_PHASE_NAME(id, name) name,
static const char *const names[] = {KILN_RECKON_PHASE_LIST(KILN_RECKON_PHASE_NAME)};
#undef KILN_RECKON_PHASE_NAME

/* Input of the functions below. */
struct reckoning {
    const struct kiln_reckon_question *q;
    const struct kiln_work *work;
    const struct kiln_backend_rates *rates;
    bool device;
    double lanes; /* threads with Embree, devices with Vulkan: what the backend's work is divided by */
    double ray;   /* s of a gather ray */
};

/* Seconds of a gather ray in a diffuse scene with so many triangles. */
static double ray_seconds(const struct kiln_backend_rates *rates, double triangles)
{
    const double doublings = fmax(log2(fmax(triangles, 1.0)) - FIRST_DOUBLINGS, 0.0),
                 cached = fmin(doublings, rates->cached);
    return rates->ray + cached * rates->doubling + (doublings - cached) * rates->doubling_uncached;
}

/* Seconds of a gather ray of the bake, as a mean; `shadow`: of one that does not go on from gloss. */
static double gather_seconds(const struct kiln_backend_rates *rates, const struct kiln_work *w, bool shadow)
{
    const double gloss = w->takes_gloss && !shadow ? rates->gloss + rates->glossy * w->gloss : 0.0,
                 factor = 1.0 + gloss + (w->cut_out ? rates->cut_out : 0.0);
    const double far = w->rounds.rounds > 1 ? 0.0 : w->far; /* what lies far off is finished with the first round */
    return (1.0 - far) * factor * ray_seconds(rates, w->triangles) + far * ray_seconds(rates, 1.0);
}

/* Seconds of work of `thread_seconds` on all threads, of which a fraction runs on one of each rank's alone. */
static double shared_seconds(const struct reckoning *r, double thread_seconds, double alone)
{
    return thread_seconds * ((1.0 - alone) / r->q->threads + alone / r->q->ranks);
}

/* ---- before the light ---- */

static void reckon_before(const struct reckoning *r, double seconds[KILN_RECKON_PHASES])
{
    const struct kiln_work *w = r->work;
    const struct kiln_host_rates *h = &kiln_host_rates;
    const double own_threads = r->q->threads / r->q->ranks; /* each rank builds its own BVH */
    const double point = h->point + (w->textured ? h->point_textured : 0.0);
    seconds[KILN_RECKON_start] = h->start + r->rates->start;
    seconds[KILN_RECKON_import] = fmax(r->q->import, 0.0);
    seconds[KILN_RECKON_world] = w->triangles * (h->geometry_alone + h->geometry / own_threads +
                                                 (r->device ? r->rates->triangle : r->rates->triangle / own_threads));
    seconds[KILN_RECKON_points] =
        shared_seconds(r, h->points + w->points * point + w->triangles * h->point_triangle, h->alone_before);
    seconds[KILN_RECKON_validity] =
        shared_seconds(r, w->points * h->valid_point + w->triangles * h->valid_triangle, h->alone_before) +
        w->points * r->rates->validity * gather_seconds(r->rates, w, true) / r->lanes;
    seconds[KILN_RECKON_emission] = h->emission / r->q->threads;
    seconds[KILN_RECKON_kernels] = r->device ? r->q->kernels * r->rates->kernel : 0.0;
}

/* ---- light ---- */

static double rays_seconds(const struct reckoning *r, enum kiln_work_kind kind, double of_ray)
{
    const struct kiln_work_rays *rays = &r->work->light[kind];
    const double dense = r->work->points > 0.0 ? fmin(r->work->triangles / r->work->points, DENSEST) : 0.0,
                 visit = r->rates->visit + dense * r->rates->visit_triangle;
    const double in_rounds = r->work->rounds.rounds == 0 ? 1.0
                             : kind == KILN_WORK_DIRECT  ? r->rates->rounds_direct
                                                         : r->rates->rounds_gather;
    return (rays->samples * of_ray * in_rounds * r->ray + rays->visits * visit) / r->lanes +
           rays->steps * r->rates->step;
}

/* Seconds of a sample of direct light over those of a gather ray. */
static double direct_over_gather(const struct reckoning *r)
{
    const double of_lamps = r->rates->direct + r->rates->direct_lamps * log2(fmax(r->work->lamps, 1.0)) +
                            (r->work->from_afar ? r->rates->direct_afar : 0.0);
    return of_lamps * gather_seconds(r->rates, r->work, true) / r->ray;
}

/* `alone`: fraction of the work that one thread of the host does while others wait. */
static double denoise_seconds(const struct reckoning *r, double points, double alone)
{
    if (!r->work->denoises)
        return 0.0;
    if (r->device)
        return points * r->rates->denoised / r->lanes + shared_seconds(r, points * r->rates->denoised_beside, 0.0);
    return shared_seconds(r, points * r->rates->denoised, alone);
}

static void reckon_light(const struct reckoning *r, double seconds[KILN_RECKON_PHASES])
{
    const struct kiln_work *w = r->work;
    seconds[KILN_RECKON_direct] = rays_seconds(r, KILN_WORK_DIRECT, direct_over_gather(r));
    seconds[KILN_RECKON_bounces] = rays_seconds(r, KILN_WORK_BOUNCE, 1.0) + w->pairs * r->ray / r->lanes;
    seconds[KILN_RECKON_final] = rays_seconds(r, KILN_WORK_FINAL, 1.0);
    seconds[KILN_RECKON_quantities] = rays_seconds(r, KILN_WORK_QUANTITY, 1.0);
    seconds[KILN_RECKON_caustics] = (w->paths * r->rates->path + w->shared * r->rates->shared * r->ray) / r->lanes +
                                    w->path_steps * r->rates->path_step +
                                    shared_seconds(r, w->spread * kiln_host_rates.spread, kiln_host_rates.alone_before);
    seconds[KILN_RECKON_judging] = w->rounds.rounds * (w->points * kiln_host_rates.judged / r->q->ranks +
                                                       denoise_seconds(r, fmin(w->points, JUDGED_MOST), 0.0));
    seconds[KILN_RECKON_probes] =
        (w->probe_samples * r->rates->probe_ray * r->ray + w->probe_paths * r->rates->probe_path) / r->lanes +
        (w->probes > 0.0 ? kiln_host_rates.probes / r->q->threads : 0.0) +
        (w->probe_paths > 0.0 ? w->triangles * r->rates->probe_triangle : 0.0);
}

/* ---- after the light ---- */

static double preview_seconds(const struct reckoning *r)
{
    const struct kiln_work *w = r->work;
    const struct kiln_backend_rates *embree = &kiln_backend_rates[KILN_RECKON_EMBREE];
    const double ray = ray_seconds(embree, w->triangles) * (w->takes_gloss ? PREVIEW_OF_GLOSS : 1.0);
    return w->preview * (kiln_host_rates.preview_rays * ray * r->q->ranks / r->q->threads +
                         kiln_host_rates.preview_alone + (w->takes_gloss ? kiln_host_rates.preview_alone_gloss : 0.0));
}

static void reckon_after(const struct reckoning *r, double seconds[KILN_RECKON_PHASES])
{
    const struct kiln_work *w = r->work;
    const struct kiln_host_rates *h = &kiln_host_rates;
    seconds[KILN_RECKON_denoising] = denoise_seconds(r, w->points, kiln_host_rates.alone_denoising);
    seconds[KILN_RECKON_lightmaps] =
        shared_seconds(r, w->points * h->texel + w->triangles * h->texel_triangle, h->alone_after);
    seconds[KILN_RECKON_h5] = shared_seconds(r, h->h5 + w->points * h->h5_point, h->alone_after);
    seconds[KILN_RECKON_preview] = preview_seconds(r);
    seconds[KILN_RECKON_rest] = h->results;
}

/* ---- all ---- */

struct kiln_reckoned kiln_reckon_bake(const struct kiln_reckon_question *q, enum kiln_reckon_backend backend)
{
    struct kiln_reckoned reckoned = {.total = 0.0};
    const struct kiln_work *w = &q->work;
    struct reckoning r = {.q = q,
                          .work = w,
                          .rates = &kiln_backend_rates[backend],
                          .device = backend == KILN_RECKON_VULKAN,
                          .lanes = backend == KILN_RECKON_VULKAN ? q->ranks : q->threads};
    r.ray = gather_seconds(r.rates, w, false);
    reckon_before(&r, reckoned.seconds);
    reckon_light(&r, reckoned.seconds);
    reckon_after(&r, reckoned.seconds);
    for (size_t i = 0; i < KILN_RECKON_PHASES; i++)
        reckoned.total += reckoned.seconds[i];
    return reckoned;
}

void kiln_reckon_put(struct kiln_reckoned *reckoned, enum kiln_reckon_phase phase, double seconds)
{
    reckoned->total += seconds - reckoned->seconds[phase];
    reckoned->seconds[phase] = seconds;
}

const char *kiln_reckon_phase_name(enum kiln_reckon_phase phase) { return names[phase]; }

enum kiln_reckon_phase kiln_reckon_phase_of(const char *name)
{
    size_t i = 0;
    while (i < KILN_RECKON_PHASES && strcmp(names[i], name) != 0)
        i++;
    return i < KILN_RECKON_PHASES ? (enum kiln_reckon_phase)i : KILN_RECKON_quantities;
}

double kiln_reckon_light(const struct kiln_reckoned *reckoned)
{
    const double *s = reckoned->seconds;
    return s[KILN_RECKON_direct] + s[KILN_RECKON_caustics] + s[KILN_RECKON_bounces] + s[KILN_RECKON_final] +
           s[KILN_RECKON_quantities] + s[KILN_RECKON_judging];
}

double kiln_reckon_after(const struct kiln_reckoned *reckoned)
{
    double seconds = 0.0;
    for (int phase = KILN_RECKON_probes; phase < KILN_RECKON_PHASES; phase++)
        seconds += reckoned->seconds[phase];
    return seconds;
}

json_t *kiln_reckon_json(const struct kiln_reckoned *reckoned)
{
    json_t *json = json_pack("{s:f}", "total", reckoned->total);
    for (size_t i = 0; i < KILN_RECKON_PHASES && json != NULL; i++)
        if (reckoned->seconds[i] > 0.0)
            (void)json_object_set_new(json, names[i], json_real(reckoned->seconds[i]));
    return json;
}
