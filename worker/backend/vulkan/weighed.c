/* The weighed pass (worker/pass/weighed.h), which this backend does not have: light paths are the host's. */
#include "worker/backend/vulkan/vulkan.h"

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)b, (void)parameters, (void)batch, (void)rays;
    return kiln_fail(error, KILN_USAGE,
                     "the Vulkan backend has no caustics that light paths share: give --backend "
                     "embree");
}

const struct vulkan_pass vulkan_pass_weighed = {.run = run};
