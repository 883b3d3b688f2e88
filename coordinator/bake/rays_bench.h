/* The measurement of `kiln bench rays`: the speed of the bounce pass relative to the bare ray tracer on the same rays.
 */
#ifndef KILN_COORDINATOR_BAKE_RAYS_BENCH_H
#define KILN_COORDINATOR_BAKE_RAYS_BENCH_H

#include "coordinator/bake/prepare/prepare.h"

struct kiln_rays_bench {
    struct kiln_backend_info info;  /* the backend that traced */
    uint64_t rays;                  /* of each run */
    double pass_rate, ceiling_rate; /* of the pass and of the bare tracer, rays per second, medians over the runs */
    double share, share_low, share_high; /* pass rate / tracer rate of each run: median, minimum, maximum */
};

/* Traces `samples` rays for each point, alternately by the gather pass and by the bare tracer, `repeats` times. Embree:
 * uses tile runs at regular intervals and one thread (prepare with threads = 1), whose processor time counts; the
 * tracer's is that of making and tracing rays less that of making them. What the tracer does is all that finds the
 * nearest hits: callbacks for masks and blended surfaces, and fronts before backs that coincide with them. Rays that
 * ask whether places are buried are the pass' alone. GPU: uses all tile runs, or as many as keep it busy for a second;
 * the tracer generates the same rays and looks nothing up; times are those of the device. The radiosity is a synthetic
 * pattern, so that lookups have their usual cost. Not collective. KILN_USAGE if the scene has no surface points. */
int kiln_rays_bench(const struct kiln_prepared *prepared, uint32_t samples, uint32_t repeats,
                    struct kiln_rays_bench *result, struct kiln_error *error);

#endif
