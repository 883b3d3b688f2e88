/* A few light paths, traced to know what many take: what lands is only counted. For `kiln plan`. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_PLAN_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_PLAN_H

#include "coordinator/integrate/companion.h"
#include "worker/pass/land.h"

/* All borrowed. */
struct kiln_landing_sampling {
    struct kiln_backend *backend, *host; /* the latter for what a device leaves to it (kiln_landing_host), or NULL */
    uint32_t threads;
    uint64_t points; /* of the surface */
};

/* Findings of these paths. */
struct kiln_landing_sampled {
    double landed;  /* share of the paths that land beside a point */
    double covered; /* share of the points that lie near a landing; of the rest caustics are 0 */
    double path;    /* s each, by all threads */
};

/* Traces paths that are spread over all aims, which have their shares. Not collective. KILN_SYSTEM. */
int kiln_landing_sample(const struct kiln_landing_sampling *sampling, const struct kiln_land_parameters *parameters,
                        struct kiln_landing_sampled *found, struct kiln_error *error);

/* `measure` and `demand` of the companion (companion.h): the step that lands; with --caustics vcm pilots are as many
 * paths as an iteration has, and the gather rays that share the light are tried on some tile runs. */
int kiln_landing_measure(const struct kiln_companion_sample *sample, struct kiln_companion_measured *measured,
                         struct kiln_error *error);
void kiln_landing_demand(const struct kiln_companion_demand *demand, struct kiln_companion_bytes *bytes);

#endif
