#include "worker/backend/verify.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "shaders/shared/random.h"
#include "worker/backend/api.h"
#include "worker/base/memory.h"

static const double MOST_ERRORS = 6.0, ROUNDING = 1e-4;

struct texel {
    uint32_t object, x, y;
    double got, expected; /* mean values of both, in the pass's unit */
};

/* Results of one pass so far. */
struct tally {
    uint64_t texels, beyond, broken;
    double difference[KILN_PASS_FIGURES], squares[KILN_PASS_FIGURES], total[KILN_PASS_FIGURES]; /* over tile runs */
    double level_difference, level_total, level_variance;                                       /* over texels */
    double worst_ratio;
    struct texel worst;
};

struct verify_backend {
    struct kiln_backend base;
    struct kiln_backend_api api; /* the checked backend's name, with our functions */
    struct kiln_backend *checked, *embree;
    struct tally tallies[KILN_PASS_COUNT];
};

/* A run under way. */
struct verified_run {
    struct verify_backend *v;
    const struct kiln_pass *pass;
    const void *parameters;
    struct tally *tally;
    const struct kiln_batch *batch; /* the caller's */
    const char *got;                /* results of the tile runs that are computed again */
};

/* ---- comparing ---- */

static struct texel texel_of(const struct kiln_surface *s, const struct kiln_tile_run *f, uint64_t mask)
{
    const uint32_t bit = (uint32_t)__builtin_ctzll(mask), tiles_x = s->lightmaps[f->map].tiles_x;
    return (struct texel){.object = kiln_map_object(s, f->map),
                          .x = f->tile % tiles_x * 8 + kiln_morton8_x(bit),
                          .y = f->tile / tiles_x * 8 + kiln_morton8_y(bit)};
}

static void compare_texel(struct tally *t, const struct kiln_pass_figures *got,
                          const struct kiln_pass_figures *expected, struct texel texel)
{
    const bool sound = got->sound && got->count == expected->count;
    texel.got = got->level;
    texel.expected = expected->level;
    const double mean = t->texels > 0 ? t->level_total / (double)t->texels : 0.0;
    const double error = sound ? hypot(got->error, expected->error) : expected->error;
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
    t->level_difference += texel.got - texel.expected;
    t->level_total += texel.expected;
    t->level_variance += error * error;
}

static void compare_tile_run(const struct verified_run *run, const struct kiln_tile_run *f, const char *got,
                             const char *expected)
{
    const struct kiln_surface *s = run->v->base.surface;
    const struct kiln_pass *pass = run->pass;
    struct tally *t = run->tally;
    double difference[KILN_PASS_FIGURES] = {0}, total[KILN_PASS_FIGURES] = {0};
    struct kiln_own_point own = kiln_own_of_global(s, f->first);
    const uint64_t points = kiln_batch_points(run->batch, (size_t)(f - s->tile_runs));
    uint64_t mask = f->mask;
    for (uint32_t i = 0; i < f->count; i++, own.at++, mask &= mask - 1) {
        if ((points >> i & 1u) == 0 || !kiln_point_valid(s, own))
            continue;
        struct kiln_pass_figures theirs, ours;
        pass->figures(got + i * pass->result_bytes, &theirs);
        pass->figures(expected + i * pass->result_bytes, &ours);
        /* results without radiosity are computed again later; the two backends may differ in their hits */
        if (run->batch->may_lack && pass->lacks != NULL &&
            (pass->lacks(got + i * pass->result_bytes) != 0 || pass->lacks(expected + i * pass->result_bytes) != 0))
            continue;
        compare_texel(t, &theirs, &ours, texel_of(s, f, mask));
        for (size_t c = 0; c < pass->figure_count; c++) {
            difference[c] += (double)theirs.value[c] - (double)ours.value[c];
            total[c] += fabs((double)ours.value[c]); /* directions have signs, and may cancel out */
        }
    }
    for (size_t c = 0; c < pass->figure_count; c++) {
        t->difference[c] += difference[c];
        t->squares[c] += difference[c] * difference[c];
        t->total[c] += total[c];
    }
}

/* kiln_take_results callback for the tile runs computed again. */
static int take_again(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct verified_run *run = context;
    const char *expected = results;
    for (size_t i = first; i < first + count; i++) {
        const struct kiln_tile_run *f = &run->v->base.surface->tile_runs[i];
        compare_tile_run(run, f, run->got, expected);
        run->got += f->count * run->pass->result_bytes;
        expected += f->count * run->pass->result_bytes;
    }
    return KILN_OK;
}

/* ---- judging ---- */

/* Returns whether the results differ too much, and writes the message to `text`. */
static bool complains(const struct kiln_pass *pass, const struct tally *t, char text[96])
{
    const char *wrong = NULL, *suffix = "";
    if (t->broken > 0)
        wrong = "values that are not numbers, or another number of samples";
    else if ((double)t->beyond > 4.0 + 0.002 * (double)t->texels)
        wrong = "too many texels beyond 6 standard errors";
    else if (t->texels >= 64 &&
             fabs(t->level_difference) > MOST_ERRORS * sqrt(t->level_variance) + 0.01 * t->level_total)
        wrong = "the sum of the texels is beyond 6 standard errors";
    for (size_t c = 0; c < pass->figure_count && wrong == NULL; c++)
        if (fabs(t->difference[c]) > MOST_ERRORS * sqrt(t->squares[c]) + ROUNDING * t->total[c]) {
            wrong = pass->figure_names[c];
            suffix = " differs to the same side everywhere";
        }
    if (wrong != NULL)
        (void)snprintf(text, 96, "%s%s", wrong, suffix);
    return wrong != NULL;
}

static int judge(const struct verified_run *run, struct kiln_error *error)
{
    const struct verify_backend *v = run->v;
    const struct tally *t = run->tally;
    char wrong[96];
    if (!complains(run->pass, t, wrong))
        return KILN_OK;
    const struct kiln_scene *scene = v->base.params.scene;
    struct kiln_backend_info info;
    kiln_backend_info(v->checked, &info);
    const double percent = t->level_total > 0.0 ? 100.0 * t->level_difference / t->level_total : 0.0;
    return kiln_fail(error, KILN_NO_DEVICE,
                     "%.120s and Embree disagree on %s: %s (%llu of %llu texels traced again, in all %+.3g %%); "
                     "worst is texel (%u, %u) of object '%.200s', %.6g against Embree's %.6g %s; do not trust this "
                     "device or its driver: leave it out with --device, or use --backend embree",
                     info.device, run->pass->what, wrong, (unsigned long long)t->beyond, (unsigned long long)t->texels,
                     percent, t->worst.x, t->worst.y, kiln_scene_string(scene, scene->objects[t->worst.object].name),
                     t->worst.got, t->worst.expected, run->pass->unit);
}

/* ---- passes ---- */

static bool is_chosen(const struct verify_backend *v, const struct kiln_tile_run *f, uint32_t stream)
{
    const uint64_t seed = v->base.params.seed;
    uint32_t hash = kiln_hash2(kiln_hash2((uint32_t)seed, (uint32_t)(seed >> 32)), 0x76657269u);
    hash = kiln_hash2(kiln_hash2(kiln_hash2(hash, f->map), f->tile), stream);
    return (double)hash < v->base.params.verify_fraction * 0x1p32;
}

static int trace_again(struct verified_run *run, size_t first, size_t count, struct kiln_error *error)
{
    const struct kiln_batch some = kiln_batch_range(run->batch, first, count),
                            chosen = kiln_batch_taken_by(&some, take_again, run);
    uint64_t rays = 0; /* not the caller's */
    return kiln_backend_run(run->v->embree, run->pass, run->parameters, &chosen, &rays, error);
}

/* kiln_take_results callback for the checked backend: compares the results before the caller takes them. */
static int take_part(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct verified_run *run = context;
    const struct kiln_tile_run *tile_runs = run->v->base.surface->tile_runs + first;
    int status = KILN_OK;
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i; end < count && is_chosen(run->v, &tile_runs[end], run->batch->stream);)
            end++;
        run->got = (const char *)results + (tile_runs[i].first.at - tile_runs[0].first.at) * run->pass->result_bytes;
        if (end > i)
            KILN_TRY(trace_again(run, first + i, end - i, error));
        else
            end = i + 1;
    }
    KILN_TRY(judge(run, error));
    if (run->batch->take != NULL)
        KILN_TRY(run->batch->take(run->batch->context, first, count, results, error));
end:
    return status;
}

static int verify_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                      const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct verify_backend *v = (struct verify_backend *)backend;
    if (pass->figures == NULL || pass->domain != KILN_DOMAIN_TILE_RUNS)
        return kiln_backend_run(v->checked, pass, parameters, batch, rays, error);
    struct verified_run run = {
        .v = v, .pass = pass, .parameters = parameters, .tally = &v->tallies[pass->index], .batch = batch};
    const struct kiln_batch watched = kiln_batch_taken_by(batch, take_part, &run);
    return kiln_backend_run(v->checked, pass, parameters, &watched, rays, error);
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
    kiln_backend_info(v->checked, info);
    info->verified = info->beyond = 0;
    info->worst = 0.0;
    for (size_t i = 0; i < KILN_PASS_COUNT; i++) {
        info->verified += v->tallies[i].texels;
        info->beyond += v->tallies[i].beyond;
        info->worst = fmax(info->worst, v->tallies[i].worst_ratio);
    }
}

static struct kiln_backend *verify_inner(const struct kiln_backend *backend)
{
    return ((const struct verify_backend *)backend)->checked;
}

/* Sets a resource of both backends; one that passes fill, only of the checked backend. */
static int verify_set(struct kiln_backend *backend, enum kiln_resource_index index, struct kiln_error *error)
{
    struct verify_backend *v = (struct verify_backend *)backend;
    const int status = kiln_backend_give(v->checked, index, &backend->given, error);
    return status == KILN_OK && !kiln_resources[index].is_filled
               ? kiln_backend_give(v->embree, index, &backend->given, error)
               : status;
}

int kiln_verify_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                       struct kiln_error *error)
{
    struct verify_backend *v = NULL;
    struct kiln_backend_params plain = *params;
    plain.verify_fraction = 0.0;
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
                                       .set = verify_set,
                                       .mixed = UINT32_MAX,
                                       .claims = UINT32_MAX,
                                       .run = verify_run,
                                       .extras = v->checked->api->extras,
                                       .inner = verify_inner};
    v->base = (struct kiln_backend){.api = &v->api, .params = *params};
    *backend = &v->base;
    return KILN_OK;
}
