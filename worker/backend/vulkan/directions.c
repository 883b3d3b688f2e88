/* The directions pass (worker/pass/directions.h), which this backend does not have: a bake that asks for it is Embree's
 * (coordinator/job/job.c). */
#include "worker/backend/vulkan/vulkan.h"

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)b, (void)parameters, (void)batch, (void)rays;
    return kiln_fail(error, KILN_USAGE, "the Vulkan backend has no light by sets of directions: give --backend embree");
}

const struct vulkan_pass vulkan_pass_directions = {.run = run};
