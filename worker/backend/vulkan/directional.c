/* The directional pass (worker/pass/directional.h): runs shaders/directional.comp and directional_reduce.comp over the
 * batch's points. */
#include "worker/backend/vulkan/hemisphere.h"
#include "worker/pass/directional.h"

#include "shaders/shared/streams.h"

static const struct vulkan_shader gloss_shader = {.name = "directional with gloss",
                                                  .compute = VULKAN_CODE(directional_gloss),
                                                  .pipeline = VULKAN_CODE(directional_gloss_pipeline),
                                                  .compute_float = VULKAN_CODE(directional_gloss_float),
                                                  .pipeline_float = VULKAN_CODE(directional_gloss_pipeline_float)};
static const struct vulkan_shader directional_shader = {.name = "directional",
                                                        .compute = VULKAN_CODE(directional),
                                                        .pipeline = VULKAN_CODE(directional_pipeline),
                                                        .compute_float = VULKAN_CODE(directional_float),
                                                        .pipeline_float = VULKAN_CODE(directional_pipeline_float),
                                                        .gloss = &gloss_shader};
static const struct vulkan_shader sums_shader = {.name = "directional: sums",
                                                 .compute = VULKAN_CODE(directional_reduce)};

_Static_assert(sizeof(struct kiln_gpu_directional_result) == sizeof(struct kiln_directional_result), "results");

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)parameters;
    const struct vulkan_hemisphere pass = {.pass = &kiln_pass_directional,
                                           .shader = &directional_shader,
                                           .sums = &sums_shader,
                                           .chains = b->materials.gloss,
                                           .pace = KILN_PASS_INDEX_directional,
                                           .stream = KILN_DIRECTIONAL_STREAM,
                                           .floats = KILN_GPU_DIRECTIONAL_FLOATS,
                                           .failed_offset = offsetof(struct kiln_gpu_directional_result, radiance),
                                           .counts_rays = true};
    return vulkan_hemisphere_run(b, &pass, batch, rays, error);
}

const struct vulkan_pass vulkan_pass_directional = {.run = run};
