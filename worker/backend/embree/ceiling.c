/* Measures Embree's ray rate in the gather pass if it only traces. */
#include <math.h>

#include "worker/backend/embree/rays.h"

/* Makes the rays of a tile run, and optionally traces them. Returns the CPU time, s. */
static double make_rays(struct tile_run_rays *r, const struct embree_backend *b, struct embree_context *context,
                        const struct kiln_batch *batch, size_t tile_run, bool traces, uint64_t *rays)
{
    const double start = embree_thread_seconds();
    const uint32_t steps = rays_begin(r, b, tile_run, batch->stream, 0);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(r, b, step);
        if (traces)
            rays_trace(r, b, context, lanes);
        *rays += lanes;
    }
    return embree_thread_seconds() - start;
}

/* Time of tracing: the time of a tile run with tracing less that without. Timing the calls of each step would take as
 * long as some of the rays, and depend on the cost of the machine's clocks. */
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
        uint64_t made = 0;
        *seconds -= make_rays(r, b, &context, batch, batch->first + i, false, &made);
        *seconds += make_rays(r, b, &context, batch, batch->first + i, true, rays);
    }
    embree_leave(saved);
    rays_destroy(&r);
    return KILN_OK;
}
