/* Estimates the cost of light paths that land (integrate/land/land.h) by a few of them, with --caustics vcm also of
 * pilots and the gather rays that share the light, by those of some tile runs. And of paths that probes get
 * (bake/volume/probe_paths.h). */
#ifndef KILN_COORDINATOR_PLAN_LANDING_H
#define KILN_COORDINATOR_PLAN_LANDING_H

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/field/result.h"
#include "coordinator/integrate/settings.h"

/* Zero: no step lands. */
struct kiln_plan_landing {
    uint64_t photons, aims;
    uint32_t iterations;
    double landed;        /* share of paths that land beside a point */
    double covered;       /* share of the points that lie near a landing; of the rest caustics are 0 */
    double path;          /* s each, by the threads of one rank */
    double gathered;      /* s of a point's rays, likewise; 0: no rays share the light */
    double seconds;       /* s of one rank that traces all paths of a step, and merges or gathers over all points */
    double probes;        /* s of one rank that traces all paths for probes */
    uint64_t probe_bytes; /* of each rank, for these */
    double bytes_sent;    /* of each rank in an iteration, to others */
};

/* Not collective. Traces some paths, as the first iteration would; the host does, beside a device. `volume`: the grid
 * of probes, with `samples_probe` rays each; 0: there is none. KILN_SYSTEM. */
int kiln_plan_landing_measure(struct kiln_plan_landing *landing, const struct kiln_prepared *prepared,
                              const struct kiln_integrate_settings *settings, const struct kiln_volume_result *volume,
                              uint32_t samples_probe, uint64_t points, uint32_t ranks, struct kiln_error *error);

#endif
