/* `kiln bench rays`: how near the bounce pass comes to Embree alone on the same rays. */
#ifndef KILN_COORDINATOR_BAKE_RAYS_BENCH_H
#define KILN_COORDINATOR_BAKE_RAYS_BENCH_H

#include "coordinator/bake/prepare.h"

struct kiln_rays_bench {
    uint64_t rays;            /* a run */
    double pass_rate, ceiling_rate; /* rays per second, medians over the runs */
    double share, share_low, share_high; /* pass over ceiling, run by run: median, least, most */
};

/* Traces a regular choice of fragments with `samples` rays a point in turn by the gather pass and by Embree alone (rays made
 * beforehand, only its calls timed), `repeats` times. The radiosity is a made-up pattern, so that lookups cost what they do.
 * One thread (prepared with threads = 1). Not collective. KILN_USAGE when the scene has no surface points. */
int kiln_rays_bench(const struct kiln_prepared *prepared, uint32_t samples, uint32_t repeats, struct kiln_rays_bench *result,
                    struct kiln_error *error);

#endif
