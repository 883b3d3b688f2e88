/* The occlusion pass (worker/pass/occlusion.h): shaders/occlusion.comp and occlusion_reduce.comp over the batch's
 * points. */
#include "worker/backend/vulkan/hemisphere.h"
#include "worker/pass/occlusion.h"

#include "shaders/shared/streams.h"

static const struct vulkan_shader occlusion_shader = {
    .name = "occlusion", .compute = VULKAN_CODE(occlusion), .pipeline = VULKAN_CODE(occlusion_pipeline)};
static const struct vulkan_shader sums_shader = {.name = "occlusion: sums", .compute = VULKAN_CODE(occlusion_reduce)};

_Static_assert(sizeof(struct kiln_gpu_occlusion_result) == sizeof(struct kiln_occlusion_result), "results");

/* Push constants of this pass, in addition to those of all hemisphere passes. */
struct own {
    float distance;
    uint32_t reserved;
};
_Static_assert(sizeof(struct kiln_gpu_occlusion_push) == sizeof(struct kiln_gpu_hemisphere_push) + sizeof(struct own),
               "the pass's own push constants come last");

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    const struct kiln_occlusion_parameters *p = parameters;
    const struct own own = {.distance = (float)p->distance};
    const struct vulkan_hemisphere pass = {.pass = &kiln_pass_occlusion,
                                           .shader = &occlusion_shader,
                                           .sums = &sums_shader,
                                           .pace = KILN_PASS_INDEX_occlusion,
                                           .stream = KILN_OCCLUSION_STREAM,
                                           .floats = KILN_GPU_OCCLUSION_FLOATS,
                                           .failed_offset = offsetof(struct kiln_gpu_occlusion_result, error),
                                           .own = &own,
                                           .own_bytes = sizeof own};
    return vulkan_hemisphere_run(b, &pass, batch, rays, error);
}

const struct vulkan_pass vulkan_pass_occlusion = {.run = run};
