/* The stages of a bake, in their order, and the seconds that each is expected to take, for the time left of the whole
 * (run/time_left.h). Expectations are of typical speeds, in one table (stages.c); a reckoning that knows better fills
 * in `seconds` by the names of the stages. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_STAGES_H
#define KILN_COORDINATOR_BAKE_PREPARE_STAGES_H

#include "coordinator/bake/prepare/prepare.h"

/* Name of the stage of all light on surfaces, which tells its own time left (integrate/light_left.h); and of all states
 * of kiln relight --states. */
#define KILN_STAGE_LIGHT "light"
#define KILN_STAGE_STATES "states"

struct kiln_stage_facts {
    const struct kiln_job *job; /* settled */
    double triangles, points, probes;
    double threads;       /* of all ranks */
    double light_seconds; /* that all light on surfaces is expected to take */
    double probe_seconds; /* likewise, the probes */
};

/* Collects the facts of a bake whose scene is open; points are estimated from the texels while there is no surface.
 * `probes`: of the irradiance volume. Not collective. */
struct kiln_stage_facts kiln_stage_facts(const struct kiln_job *job, const struct kiln_prepared *prepared,
                                         uint64_t probes);

/* Fills in the stages that the job has; returns their number. */
size_t kiln_stages_make(const struct kiln_stage_facts *facts, struct kiln_stage stages[KILN_STAGES_MAX]);

#endif
