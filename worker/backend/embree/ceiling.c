/* How many rays of the gather pass Embree traces if it does nothing else. */
#include <math.h>
#include <time.h>

#include "worker/backend/embree/rays.h"

static double seconds_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int embree_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                   struct kiln_error *error)
{
    struct embree_backend *b = (struct embree_backend *)backend;
    struct tile_run_rays *r = NULL;
    const int status = rays_create(&r, RAYS_HALF_WAY, INFINITY, batch, error);
    if (status != KILN_OK)
        return status;
    const unsigned saved = embree_enter();
    struct embree_context context;
    embree_context(b, &context);
    for (size_t i = 0; i < batch->count; i++) {
        const uint32_t steps = rays_begin(r, b, batch->first + i, batch->stream, 0);
        for (uint32_t step = 0; step < steps; step++) {
            const uint32_t lanes = rays_make(r, b, step);
            const double start = seconds_now();
            rays_trace(r, b, &context, lanes);
            *seconds += seconds_now() - start;
            *rays += lanes;
        }
    }
    embree_leave(saved);
    rays_destroy(&r);
    return KILN_OK;
}
