/* `kiln bench rays`: how near the bounce pass comes to the tracer alone on the same rays. */
#ifndef KILN_COORDINATOR_BAKE_RAYS_BENCH_H
#define KILN_COORDINATOR_BAKE_RAYS_BENCH_H

#include "coordinator/bake/prepare.h"

struct kiln_rays_bench {
    struct kiln_backend_info info;       /* what traced */
    uint64_t rays;                       /* a run */
    double pass_rate, ceiling_rate;      /* rays per second, medians over the runs */
    double share, share_low, share_high; /* pass over ceiling, run by run: median, least, most */
};

/* Traces `samples` rays a point in turn by the gather pass and by the tracer alone, `repeats` times. Embree: of a
 * regular choice of tile runs, the tracer with rays made beforehand and only its calls timed, one thread (prepared with
 * threads = 1). A device: of all tile runs, or as many as keep it busy for a second; the tracer makes the same rays and
 * looks nothing up, by the device's clock. The radiosity is a made-up pattern, so that lookups cost what they do. Not
 * collective. KILN_USAGE when the scene has no surface points. */
int kiln_rays_bench(const struct kiln_prepared *prepared, uint32_t samples, uint32_t repeats,
                    struct kiln_rays_bench *result, struct kiln_error *error);

#endif
