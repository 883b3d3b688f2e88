/* The caustic pass (worker/pass/caustic.h): shaders/caustic.comp and gather_reduce.comp over the batch's points. */
#include "shaders/shared/streams.h"
#include "worker/backend/vulkan/hemisphere.h"
#include "worker/pass/caustic.h"

static const struct vulkan_shader caustic_shader = {.name = "caustic",
                                                    .compute = VULKAN_CODE(caustic),
                                                    .pipeline = VULKAN_CODE(caustic_pipeline),
                                                    .compute_float = VULKAN_CODE(caustic_float),
                                                    .pipeline_float = VULKAN_CODE(caustic_pipeline_float)};
static const struct vulkan_shader sums_shader = {.name = "caustic: sums", .compute = VULKAN_CODE(gather_reduce)};

/* In the place of the gather pass's LOOKUP: surfaces. */
enum { SURFACES = 1 };

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)parameters;
    const uint64_t own[2] = {0, 0}; /* the kernel asks no radiance probes */
    const bool tints = b->params.geometry->passage >= KILN_PASSAGE_TINT;
    const struct vulkan_hemisphere pass = {.pass = &kiln_pass_caustic,
                                           .shader = &caustic_shader,
                                           .sums = &sums_shader,
                                           .chains = true,
                                           .constant = SURFACES,
                                           .own = own,
                                           .own_bytes = sizeof own,
                                           .pace = KILN_PASS_INDEX_caustic,
                                           .stream = KILN_CAUSTIC_STREAM + batch->stream,
                                           .floats = tints ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS,
                                           .failed_offset = offsetof(struct kiln_gpu_result, error)};
    return vulkan_hemisphere_run(b, &pass, batch, rays, error);
}

const struct vulkan_pass vulkan_pass_caustic = {.run = run};
