/* The occlusion pass (worker/pass/occlusion.h). */
#include "worker/backend/vulkan/vulkan.h"
#include "worker/pass/occlusion.h"

int vulkan_occlusion(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
                     struct kiln_error *error)
{
    (void)b, (void)parameters, (void)batch, (void)rays;
    return kiln_fail(error, KILN_BUG, "not yet");
}
