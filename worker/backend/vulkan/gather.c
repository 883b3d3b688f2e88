/* The gather pass (worker/pass/gather.h): runs shaders/gather.comp and gather_reduce.comp over the batch's points, or
 * their variants with gloss if rays continue in chains. */
#include <string.h>

#include "worker/backend/vulkan/hemisphere.h"
#include "worker/backend/vulkan/kept_rows.h"
#include "worker/pass/gather.h"
#include "worker/pass/rows.h"

static const struct vulkan_shader gloss_shader = {
    .name = "gather with gloss", .compute = VULKAN_CODE(gather_gloss), .pipeline = VULKAN_CODE(gather_gloss_pipeline)};
static const struct vulkan_shader gather_shader = {
    .name = "gather", .compute = VULKAN_CODE(gather), .pipeline = VULKAN_CODE(gather_pipeline), .gloss = &gloss_shader};
static const struct vulkan_shader chains_shader = {
    .name = "gather: chains", .compute = VULKAN_CODE(chains), .pipeline = VULKAN_CODE(chains_pipeline)};
static const struct vulkan_shader chains_add_shader = {.name = "gather: sums of chains",
                                                       .compute = VULKAN_CODE(chains_add)};
static const struct vulkan_shader gloss_sums_shader = {.name = "gather with gloss: sums",
                                                       .compute = VULKAN_CODE(gather_reduce_gloss)};
static const struct vulkan_shader sums_shader = {
    .name = "gather: sums", .compute = VULKAN_CODE(gather_reduce), .gloss = &gloss_sums_shader};

/* Lookups of the kernel: none, for timing; surfaces; surfaces, and probes beyond the range. */
enum { TRACE_ONLY, SURFACES, SURFACES_AND_PROBES };

/* Its push constants have two addresses beside those of every pass over the hemisphere. */
_Static_assert(sizeof(struct kiln_gpu_gather_push) == sizeof(struct kiln_gpu_hemisphere_push) + 2 * sizeof(uint64_t),
               "the pass's own push constants come last");

/* ---- the pass ---- */

static struct vulkan_hemisphere gather_of(const struct vulkan_backend *b, const struct kiln_batch *batch,
                                          uint32_t lookup, const uint64_t own[2])
{
    const bool tints = b->params.geometry->passage >= KILN_PASSAGE_TINT, chains = b->materials.gloss,
               apart = chains && lookup != TRACE_ONLY;
    return (struct vulkan_hemisphere){.pass = &kiln_pass_gather,
                                      .shader = &gather_shader,
                                      .sums = &sums_shader,
                                      .chains = chains,
                                      .apart = apart ? &chains_shader : NULL,
                                      .apart_sums = apart ? &chains_add_shader : NULL,
                                      .apart_ray_bytes = KILN_GPU_APART_RAY_BYTES,
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
    pass->sums_constant = VULKAN_SHORT;
    pass->result_bytes = vulkan_answer_of_gather(b, batch->samples).words * sizeof(float);
    pass->failed_offset = KILN_GPU_SHORT_ERROR * sizeof(float);
    pass->lengthen = vulkan_lengthen_gather;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)parameters;
    const uint64_t own[2] = {0, 0}; /* filled in for each chunk */
    if (b->base.given.rows != NULL && vulkan_keeps_rows(b) && batch->samples <= b->base.given.rows->samples)
        return vulkan_gather_rows(b, batch, rays, error);
    struct vulkan_hemisphere pass = vulkan_gather_pass(b, batch, own);
    shorten(b, batch, &pass);
    return b->base.given.groups != NULL ? vulkan_gather_groups(b, &pass, batch, rays, error)
                                        : vulkan_hemisphere_run(b, &pass, batch, rays, error);
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

static bool has_chains(const struct vulkan_backend *b) { return b->materials.gloss; }

const struct vulkan_pass vulkan_pass_gather = {
    .run = run,
    .ahead = {{.shader = &gather_shader, .draw_again = true, .own = SURFACES},
              {.shader = &gather_shader, .own = SURFACES},
              {.shader = &sums_shader, .own = VULKAN_SHORT},
              {.shader = &chains_shader, .wanted = has_chains},
              {.shader = &chains_add_shader, .wanted = has_chains},
              {.shader = &chains_add_shader, .own = 1, .wanted = has_chains}}};
