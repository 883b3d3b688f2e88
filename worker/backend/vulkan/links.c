/* The links pass (worker/pass/links.h), which this backend does not have: a bake that asks for it is Embree's
 * (coordinator/job/job.c). */
#include "worker/backend/vulkan/vulkan.h"

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)b, (void)parameters, (void)batch, (void)rays;
    return kiln_fail(error, KILN_USAGE, "the Vulkan backend has no links between patches: give --backend embree");
}

const struct vulkan_pass vulkan_pass_links = {.run = run};
