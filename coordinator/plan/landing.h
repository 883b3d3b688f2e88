/* What light paths that land (integrate/land.h) will take, by a few of them. Pilots, and gather rays that share the
 * light with the paths (--caustics vcm), are not counted. */
#ifndef KILN_COORDINATOR_PLAN_LANDING_H
#define KILN_COORDINATOR_PLAN_LANDING_H

#include "coordinator/bake/prepare.h"
#include "coordinator/integrate/settings.h"

/* Zero: no step lands. */
struct kiln_plan_landing {
    uint64_t photons, aims;
    uint32_t iterations;
    double landed;     /* share of paths that land beside a point */
    double path;       /* s each, by the threads of one rank */
    double seconds;    /* s of one rank that traces all paths of a step, and merges them over all points */
    double bytes_sent; /* of each rank in an iteration, to others */
};

/* Not collective. Traces some paths, as the first iteration would; the host does, beside a device. KILN_SYSTEM. */
int kiln_plan_landing_measure(struct kiln_plan_landing *landing, const struct kiln_prepared *prepared,
                              const struct kiln_integrate_settings *settings, uint64_t points, uint32_t ranks,
                              struct kiln_error *error);

#endif
