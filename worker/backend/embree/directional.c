/* The directional pass (worker/pass/directional.h). */
#include "worker/backend/embree/embree.h"
#include "worker/pass/directional.h"

int embree_directional(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                       uint64_t *rays, struct kiln_error *error)
{
    (void)b, (void)parameters, (void)part, (void)results, (void)rays;
    return kiln_fail(error, KILN_BUG, "not yet");
}
