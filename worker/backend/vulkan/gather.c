/* The gather pass (worker/pass/gather.h): shaders/gather.comp and gather_reduce.comp over the batch's points, or
 * their variants with gloss where rays go on in chains. */
#include <string.h>

#include "worker/backend/vulkan/hemisphere.h"
#include "worker/backend/vulkan/kept_rows.h"
#include "worker/pass/gather.h"
#include "worker/pass/rows.h"

#include "shaders/gather.h"
#include "shaders/gather_gloss.h"
#include "shaders/gather_gloss_pipeline.h"
#include "shaders/gather_pipeline.h"
#include "shaders/gather_reduce.h"
#include "shaders/gather_reduce_gloss.h"

static const struct vulkan_shader gloss_shader = {
    .name = "gather with gloss", .compute = VULKAN_CODE(gather_gloss), .pipeline = VULKAN_CODE(gather_gloss_pipeline)};
static const struct vulkan_shader gather_shader = {
    .name = "gather", .compute = VULKAN_CODE(gather), .pipeline = VULKAN_CODE(gather_pipeline), .gloss = &gloss_shader};
static const struct vulkan_shader gloss_sums_shader = {.name = "gather with gloss: sums",
                                                       .compute = VULKAN_CODE(gather_reduce_gloss)};
static const struct vulkan_shader sums_shader = {
    .name = "gather: sums", .compute = VULKAN_CODE(gather_reduce), .gloss = &gloss_sums_shader};

/* What the kernel asks: nothing, rays are traced and that is all; surfaces; surfaces, and probes behind the range. */
enum { TRACE_ONLY, SURFACES, SURFACES_AND_PROBES };

/* Its push constants have two addresses beside those of every pass over the hemisphere. */
_Static_assert(sizeof(struct kiln_gpu_gather_push) == sizeof(struct kiln_gpu_hemisphere_push) + 2 * sizeof(uint64_t),
               "the pass's own push constants come last");

/* ---- answers ---- */

/* In the place of the second kernel's own constant: answers are short. */
enum { SHORT = 1 };

/* What of a short answer there is (shaders/shared/layout.h). */
struct form {
    bool whole, mixed, tints, gloss, alpha;
    size_t words;
};

static struct form form_of(const struct vulkan_backend *b, uint32_t samples)
{
    struct form f = {.mixed = b->constants[VULKAN_HAS_SMOOTH] != 0 || b->materials.gloss,
                     .tints = b->params.geometry->passage >= KILN_PASSAGE_TINT,
                     .gloss = b->materials.gloss,
                     .alpha = b->params.geometry->passage != KILN_PASSAGE_NONE};
    f.whole = !f.mixed && samples <= KILN_GPU_SHORT_MOST;
    f.words = KILN_GPU_SHORT_RAYS + (f.whole ? 1u : 2u) + (f.mixed ? 3u : 0u) + (f.tints ? 3u : 0u) +
              (f.gloss ? 3u : 0u) + (f.alpha ? 1u : 0u);
    return f;
}

static const float *take_colors(const float *from, float colors[3])
{
    memcpy(colors, from, 3 * sizeof *colors);
    return from + 3;
}

/* The answer of a valid point from its words. */
static void lengthen_one(const struct form *f, const float *from, uint32_t samples, struct kiln_point_result *r)
{
    *r = (struct kiln_point_result){.present = 1.0f, .count = samples};
    from = take_colors(from, r->incident);
    r->error = *from++;
    if (f->whole) {
        uint32_t rays;
        memcpy(&rays, from++, sizeof rays);
        r->escaped = (float)(rays & 0xffffu);
        r->blocked = (float)(rays >> 16);
    } else {
        r->escaped = *from++;
        r->blocked = *from++;
    }
    memcpy(r->irradiance, r->incident, sizeof r->irradiance);
    if (f->mixed)
        from = take_colors(from, r->irradiance);
    if (f->tints)
        from = take_colors(from, r->glass);
    if (f->gloss)
        from = take_colors(from, r->gloss);
    if (f->alpha)
        r->present = *from;
}

/* vulkan_hemisphere.lengthen */
static void lengthen(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run, const void *from,
                     void *to)
{
    const struct form f = form_of(b, batch->samples);
    const struct kiln_tile_run *run = &b->surface->tile_runs[tile_run];
    const uint64_t points = kiln_batch_points(batch, tile_run), own = kiln_own_of_global(b->surface, run->first).at;
    struct kiln_point_result *results = to;
    for (uint32_t k = 0; k < run->count; k++)
        if ((points >> k & 1u) != 0 && kiln_point_valid(b->surface, (struct kiln_own_point){own + k}))
            lengthen_one(&f, (const float *)from + k * f.words, batch->samples, &results[k]);
        else
            results[k] = (struct kiln_point_result){.count = 0};
}

/* ---- the pass ---- */

static struct vulkan_hemisphere gather_of(const struct vulkan_backend *b, const struct kiln_batch *batch,
                                          uint32_t lookup, const uint64_t own[2])
{
    const bool tints = b->params.geometry->passage >= KILN_PASSAGE_TINT, chains = b->materials.gloss;
    return (struct vulkan_hemisphere){.pass = &kiln_pass_gather,
                                      .shader = &gather_shader,
                                      .sums = &sums_shader,
                                      .chains = chains,
                                      .constant = lookup,
                                      .own = own,
                                      .own_bytes = 2 * sizeof *own,
                                      .asks_probes = lookup == SURFACES_AND_PROBES,
                                      .pace = KILN_PASS_INDEX_gather,
                                      .stream = batch->stream,
                                      .floats = (tints ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS) +
                                                (chains ? KILN_GPU_SLICE_GLOSS : 0u),
                                      .failed_offset = offsetof(struct kiln_gpu_result, error)};
}

struct vulkan_hemisphere vulkan_gather_pass(const struct vulkan_backend *b, const struct kiln_batch *batch,
                                            const uint64_t own[2])
{
    return gather_of(b, batch, b->probes != NULL ? SURFACES_AND_PROBES : SURFACES, own);
}

/* Makes its answers short. */
static void shorten(const struct vulkan_backend *b, const struct kiln_batch *batch, struct vulkan_hemisphere *pass)
{
    pass->sums_constant = SHORT;
    pass->result_bytes = form_of(b, batch->samples).words * sizeof(float);
    pass->failed_offset = KILN_GPU_SHORT_ERROR * sizeof(float);
    pass->lengthen = lengthen;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)parameters;
    const uint64_t own[2] = {0, 0}; /* filled in for each chunk */
    if (b->base.rows != NULL && vulkan_keeps_rows(b) && batch->samples <= b->base.rows->samples)
        return vulkan_gather_rows(b, batch, rays, error);
    struct vulkan_hemisphere pass = vulkan_gather_pass(b, batch, own);
    shorten(b, batch, &pass);
    return vulkan_hemisphere_run(b, &pass, batch, rays, error);
}

int vulkan_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                   struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    struct kiln_batch nobody = *batch;
    nobody.take = NULL;
    const uint64_t own[2] = {0, 0};
    struct vulkan_hemisphere pass = gather_of(b, &nobody, TRACE_ONLY, own);
    pass.pace = VULKAN_PACE_CEILING;
    pass.seconds = seconds;
    shorten(b, &nobody, &pass);
    return vulkan_hemisphere_run(b, &pass, &nobody, rays, error);
}

const struct vulkan_pass vulkan_pass_gather = {
    .run = run,
    .ahead = {{.shader = &gather_shader, .draw_again = true, .own = SURFACES},
              {.shader = &gather_shader, .own = SURFACES},
              {.shader = &sums_shader, .own = SHORT}}};
