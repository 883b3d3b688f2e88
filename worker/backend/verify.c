#include "worker/backend/verify.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "shaders/shared/random.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

enum { CHANNELS = 6 }; /* irradiance, incident */

static const double MOST_ERRORS = 6.0, ROUNDING = 1e-4;

struct texel {
    uint32_t object, x, y;
    double got, expected; /* luminance, W/m2 */
};

/* What one kind of pass has shown so far. */
struct tally {
    const char *pass;
    uint64_t texels, beyond, broken;
    double difference[CHANNELS], squares[CHANNELS], total[CHANNELS];  /* over tile runs */
    double luminance_difference, luminance_total, luminance_variance; /* over texels */
    double worst_ratio;
    struct texel worst;
};

struct verify_backend {
    struct kiln_backend base;
    struct kiln_backend_api api; /* the checked backend's name, our functions */
    struct kiln_backend *checked, *embree;
    const struct kiln_surface *surface;
    struct tally direct, gather;
};

/* A pass under way. */
struct verified_pass {
    struct verify_backend *v;
    struct tally *tally;
    const struct kiln_batch *batch; /* the caller's */
    uint32_t samples, stream;
    const struct kiln_point_result *got; /* of the tile runs that are traced again */
};

/* ---- comparing ---- */

static bool is_sound(const struct kiln_point_result *r)
{
    for (int c = 0; c < 3; c++)
        if (!isfinite(r->irradiance[c]) || !isfinite(r->incident[c]) || r->irradiance[c] < 0.0f ||
            r->incident[c] < 0.0f)
            return false;
    return isfinite(r->error) && r->error >= 0.0f;
}

static struct texel texel_of(const struct kiln_surface *s, const struct kiln_tile_run *f, uint64_t mask)
{
    const uint32_t bit = (uint32_t)__builtin_ctzll(mask), tiles_x = s->lightmaps[f->map].tiles_x;
    return (struct texel){.object = kiln_map_object(s, f->map),
                          .x = f->tile % tiles_x * 8 + kiln_morton8_x(bit),
                          .y = f->tile / tiles_x * 8 + kiln_morton8_y(bit)};
}

static void compare_texel(struct tally *t, const struct kiln_point_result *got,
                          const struct kiln_point_result *expected, struct texel texel)
{
    texel.got = kiln_luminance_of_floats(got->irradiance);
    texel.expected = kiln_luminance_of_floats(expected->irradiance);
    const double mean = t->texels > 0 ? t->luminance_total / (double)t->texels : 0.0;
    const bool sound = is_sound(got);
    const double error = sound ? hypot((double)got->error, (double)expected->error) : (double)expected->error;
    const double allowed =
        MOST_ERRORS * error + ROUNDING * fmax(fabs(texel.got), texel.expected) + 0.1 * ROUNDING * mean;
    const double apart = fabs(texel.got - texel.expected), ratio = sound ? apart / fmax(allowed, 1e-300) : INFINITY;
    t->texels++;
    t->broken += sound ? 0 : 1;
    t->beyond += ratio > 1.0 ? 1 : 0;
    if (ratio > t->worst_ratio) {
        t->worst_ratio = ratio;
        t->worst = texel;
    }
    if (!sound)
        return;
    t->luminance_difference += texel.got - texel.expected;
    t->luminance_total += texel.expected;
    t->luminance_variance += error * error;
}

static void compare_tile_run(struct tally *t, const struct kiln_surface *s, const struct kiln_tile_run *f,
                             const struct kiln_point_result *got, const struct kiln_point_result *expected)
{
    double difference[CHANNELS] = {0}, total[CHANNELS] = {0};
    uint64_t mask = f->mask;
    for (uint32_t i = 0; i < f->count; i++, mask &= mask - 1) {
        if (!kiln_point_valid(s, f->first - s->first + i))
            continue;
        compare_texel(t, &got[i], &expected[i], texel_of(s, f, mask));
        for (int c = 0; c < CHANNELS; c++) {
            const double ours = (double)(c < 3 ? expected[i].irradiance[c] : expected[i].incident[c - 3]);
            difference[c] += (double)(c < 3 ? got[i].irradiance[c] : got[i].incident[c - 3]) - ours;
            total[c] += ours;
        }
    }
    for (int c = 0; c < CHANNELS; c++) {
        t->difference[c] += difference[c];
        t->squares[c] += difference[c] * difference[c];
        t->total[c] += total[c];
    }
}

/* kiln_take_results of the pass that traces tile runs again. */
static int take_again(void *context, size_t tile_run_first, size_t tile_run_count,
                      const struct kiln_point_result *results, struct kiln_error *error)
{
    (void)error;
    struct verified_pass *pass = context;
    const struct kiln_surface *s = pass->v->surface;
    for (size_t i = tile_run_first; i < tile_run_first + tile_run_count; i++) {
        compare_tile_run(pass->tally, s, &s->tile_runs[i], pass->got, results);
        pass->got += s->tile_runs[i].count;
        results += s->tile_runs[i].count;
    }
    return KILN_OK;
}

/* ---- judging ---- */

/* What is wrong, or NULL. */
static const char *complaint(const struct tally *t)
{
    if (t->broken > 0)
        return "values that are not numbers";
    if ((double)t->beyond > 4.0 + 0.002 * (double)t->texels)
        return "too many texels beyond 6 standard errors";
    if (t->texels >= 64 &&
        fabs(t->luminance_difference) > MOST_ERRORS * sqrt(t->luminance_variance) + 0.01 * t->luminance_total)
        return "the sum of the texels is beyond 6 standard errors";
    for (int c = 0; c < CHANNELS; c++)
        if (fabs(t->difference[c]) > MOST_ERRORS * sqrt(t->squares[c]) + ROUNDING * t->total[c])
            return c < 3 ? "irradiance differs to the same side everywhere"
                         : "incident light differs to the same side everywhere";
    return NULL;
}

static int judge(const struct verify_backend *v, const struct tally *t, struct kiln_error *error)
{
    const char *wrong = complaint(t);
    if (wrong == NULL)
        return KILN_OK;
    const struct kiln_scene *scene = v->base.params.scene;
    struct kiln_backend_info info;
    v->checked->api->info(v->checked, &info);
    const double percent = t->luminance_total > 0.0 ? 100.0 * t->luminance_difference / t->luminance_total : 0.0;
    return kiln_fail(error, KILN_NO_DEVICE,
                     "%.120s and Embree disagree on %s light: %s (%llu of %llu texels traced again, in all %+.3g %%); "
                     "worst is texel "
                     "(%u, %u) of object '%.200s', %.6g against Embree's %.6g W/m2; do not trust this device or its "
                     "driver: leave it "
                     "out with --device, or use --backend embree",
                     info.device, t->pass, wrong, (unsigned long long)t->beyond, (unsigned long long)t->texels, percent,
                     t->worst.x, t->worst.y, kiln_scene_string(scene, scene->objects[t->worst.object].name),
                     t->worst.got, t->worst.expected);
}

/* ---- passes ---- */

static bool is_chosen(const struct verify_backend *v, const struct kiln_tile_run *f, uint32_t stream)
{
    const uint64_t seed = v->base.params.seed;
    uint32_t hash = kiln_hash2(kiln_hash2((uint32_t)seed, (uint32_t)(seed >> 32)), 0x76657269u);
    hash = kiln_hash2(kiln_hash2(kiln_hash2(hash, f->map), f->tile), stream);
    return (double)hash < v->base.params.verify_share * 0x1p32;
}

static int trace_again(struct verified_pass *pass, size_t tile_run_first, size_t tile_run_count,
                       struct kiln_error *error)
{
    struct kiln_backend *embree = pass->v->embree;
    const struct kiln_batch chosen = {tile_run_first, tile_run_count, take_again, pass};
    uint64_t rays = 0; /* not the caller's */
    if (pass->tally == &pass->v->direct)
        return embree->api->direct(embree, &chosen, pass->samples, &rays, error);
    return embree->api->gather(embree, &chosen, pass->samples, pass->stream, &rays, error);
}

/* kiln_take_results of the checked backend's pass: looks before the caller takes. */
static int take_part(void *context, size_t tile_run_first, size_t tile_run_count,
                     const struct kiln_point_result *results, struct kiln_error *error)
{
    struct verified_pass *pass = context;
    const struct kiln_tile_run *tile_runs = pass->v->surface->tile_runs + tile_run_first;
    int status = KILN_OK;
    for (size_t first = 0, end; first < tile_run_count && status == KILN_OK; first = end) {
        for (end = first; end < tile_run_count && is_chosen(pass->v, &tile_runs[end], pass->stream);)
            end++;
        pass->got = results + (tile_runs[first].first - tile_runs[0].first);
        if (end > first)
            status = trace_again(pass, tile_run_first + first, end - first, error);
        else
            end = first + 1;
    }
    if (status == KILN_OK)
        status = judge(pass->v, pass->tally, error);
    if (status == KILN_OK && pass->batch->take != NULL)
        status = pass->batch->take(pass->batch->context, tile_run_first, tile_run_count, results, error);
    return status;
}

static int verify_direct(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint64_t *rays,
                         struct kiln_error *error)
{
    struct verify_backend *v = (struct verify_backend *)backend;
    struct verified_pass pass = {.v = v, .tally = &v->direct, .batch = batch, .samples = samples};
    const struct kiln_batch watched = {batch->tile_run_first, batch->tile_run_count, take_part, &pass};
    return v->checked->api->direct(v->checked, &watched, samples, rays, error);
}

static int verify_gather(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples,
                         uint32_t stream, uint64_t *rays, struct kiln_error *error)
{
    struct verify_backend *v = (struct verify_backend *)backend;
    struct verified_pass pass = {.v = v, .tally = &v->gather, .batch = batch, .samples = samples, .stream = stream};
    const struct kiln_batch watched = {batch->tile_run_first, batch->tile_run_count, take_part, &pass};
    return v->checked->api->gather(v->checked, &watched, samples, stream, rays, error);
}

/* ---- what is handed on ---- */

static void verify_destroy(struct kiln_backend **backend)
{
    struct verify_backend *v = (struct verify_backend *)*backend;
    if (v == NULL)
        return;
    kiln_backend_destroy(&v->checked);
    kiln_backend_destroy(&v->embree);
    kiln_free(backend);
}

static void verify_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    const struct verify_backend *v = (const struct verify_backend *)backend;
    v->checked->api->info(v->checked, info);
    info->verified = v->direct.texels + v->gather.texels;
    info->beyond = v->direct.beyond + v->gather.beyond;
    info->worst = fmax(v->direct.worst_ratio, v->gather.worst_ratio);
}

static int verify_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface,
                              struct kiln_error *error)
{
    struct verify_backend *v = (struct verify_backend *)backend;
    v->surface = surface;
    const int status = v->checked->api->set_surface(v->checked, surface, error);
    return status == KILN_OK ? v->embree->api->set_surface(v->embree, surface, error) : status;
}

static int verify_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    struct verify_backend *v = (struct verify_backend *)backend;
    const int status = v->checked->api->set_radiosity(v->checked, radiosity, error);
    return status == KILN_OK ? v->embree->api->set_radiosity(v->embree, radiosity, error) : status;
}

static int verify_validity(struct kiln_backend *backend, size_t tile_run_first, size_t tile_run_count,
                           uint16_t *visible, struct kiln_error *error)
{
    struct kiln_backend *b = ((struct verify_backend *)backend)->checked;
    return b->api->validity(b, tile_run_first, tile_run_count, visible, error);
}

static int verify_probes(struct kiln_backend *backend, const struct kiln_vec3 *positions, size_t count,
                         uint64_t index_first, uint32_t samples, struct kiln_probe_result *results, uint64_t *rays,
                         struct kiln_error *error)
{
    struct kiln_backend *b = ((struct verify_backend *)backend)->checked;
    return b->api->probes(b, positions, count, index_first, samples, results, rays, error);
}

static int verify_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                            const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                            struct kiln_error *error)
{
    struct kiln_backend *b = ((struct verify_backend *)backend)->checked;
    return b->api->intersect(b, origins, directions, count, hits, error);
}

static int verify_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples,
                          uint32_t stream, double *seconds, uint64_t *rays, struct kiln_error *error)
{
    struct kiln_backend *b = ((struct verify_backend *)backend)->checked;
    return b->api->ceiling(b, batch, samples, stream, seconds, rays, error);
}

int kiln_verify_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                       struct kiln_error *error)
{
    struct verify_backend *v = NULL;
    struct kiln_backend_params plain = *params;
    plain.verify_share = 0.0;
    int status = kiln_allocate(&v, 1, sizeof *v, "the verifying backend", error);
    if (status == KILN_OK)
        status = kiln_backend_create(&v->embree, "embree", &plain, error);
    if (status != KILN_OK) {
        if (v != NULL)
            kiln_free(&v);
        kiln_backend_destroy(backend);
        return status;
    }
    v->checked = *backend;
    v->api = (struct kiln_backend_api){.name = v->checked->api->name,
                                       .destroy = verify_destroy,
                                       .info = verify_info,
                                       .set_surface = verify_set_surface,
                                       .set_radiosity = verify_set_radiosity,
                                       .validity = verify_validity,
                                       .direct = verify_direct,
                                       .gather = verify_gather,
                                       .probes = verify_probes,
                                       .intersect = verify_intersect,
                                       .ceiling = verify_ceiling};
    v->base = (struct kiln_backend){.api = &v->api, .params = *params};
    v->direct.pass = "direct";
    v->gather.pass = "gathered";
    *backend = &v->base;
    return KILN_OK;
}
