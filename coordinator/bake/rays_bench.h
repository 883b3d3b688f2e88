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

/* Measures `samples` rays for each point, `repeats` times, alternately by the gather pass and by the bare tracer.
 * Embree: uses tile runs at regular intervals and one thread (prepare with threads = 1), and counts processor time. The
 * tracer's time is the time of making and tracing rays minus the time of making them. It includes all work that finds
 * the nearest hits: callbacks for masks and blended surfaces, and fronts before coinciding backs. Rays that test
 * whether places are buried count for the pass alone. GPU: uses all tile runs, or as many as keep it busy for a second,
 * and counts device time; the tracer generates the same rays and looks nothing up. The radiosity is a synthetic
 * pattern, so that lookups have their usual cost. Not collective. KILN_USAGE if the scene has no surface points. */
int kiln_rays_bench(const struct kiln_prepared *prepared, uint32_t samples, uint32_t repeats,
                    struct kiln_rays_bench *result, struct kiln_error *error);

#endif
