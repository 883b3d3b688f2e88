/* The stages of a bake, in their order, and the seconds that each is expected to take, for the time left of the whole
 * (run/time_left.h), by the reckoning of a bake's time (bake/reckon/reckon.h). */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_STAGES_H
#define KILN_COORDINATOR_BAKE_PREPARE_STAGES_H

#include "coordinator/bake/prepare/prepare.h"

/* Name of the stage of all light on surfaces, which tells its own time left (integrate/light_left.h); and of all states
 * of kiln relight --states. */
#define KILN_STAGE_LIGHT "light"
#define KILN_STAGE_STATES "states"

/* Fills in the stages that a settled job has, with the seconds of the reckoning; returns their number. */
size_t kiln_stages_make(const struct kiln_job *job, const struct kiln_reckoned *expected,
                        struct kiln_stage stages[KILN_STAGES_MAX]);

#endif
