/* The directional pass (worker/pass/directional.h). */
#include "worker/backend/vulkan/vulkan.h"
#include "worker/pass/directional.h"

int vulkan_directional(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
                       struct kiln_error *error)
{
    (void)b, (void)parameters, (void)batch, (void)rays;
    return kiln_fail(error, KILN_BUG, "not yet");
}
