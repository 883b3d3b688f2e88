/* How long each phase of a run takes on each rank. */
#ifndef KILN_COORDINATOR_RUN_PHASES_H
#define KILN_COORDINATOR_RUN_PHASES_H

#include <jansson.h>
#include <mpi.h>
#include <stddef.h>

#include "coordinator/run/trace.h"
#include "coordinator/mpi/watchdog.h"

enum { KILN_PHASES_MAX = 24 };

struct kiln_phases {
    const char *name[KILN_PHASES_MAX]; /* static strings */
    double seconds[KILN_PHASES_MAX];
    size_t count, present;
    double since;                   /* when the present phase began; 0: none */
    double begin;                   /* of the run */
    struct kiln_trace *trace;       /* borrowed; NULL: none */
    struct kiln_watchdog *watchdog; /* is told where this rank stands; borrowed; NULL: none */
};

/* Ends the present phase and begins (or goes on with) the one called `name`; NULL begins none. The ranks must begin the
 * same phases for the first time in the same order. Not collective. */
void kiln_phase(struct kiln_phases *phases, const char *name);
/* Adds time that was measured elsewhere. */
void kiln_phase_add(struct kiln_phases *phases, const char *name, double seconds);
/* Adds what none of them had since the run began as the phase "other", so that a rank's phases add up to its time.
 * `before`: seconds of earlier runs of the same bake, whose parts of some phases were added. */
void kiln_phase_rest(struct kiln_phases *phases, double before);

/* Collective. On rank 0 an array of {name, seconds: {min, avg, max}, imbalance, per_rank: []}, elsewhere NULL. `all`:
 * rank 0's room for KILN_PHASES_MAX values a rank. */
json_t *kiln_phases_json(const struct kiln_phases *phases, MPI_Comm communicator, double *all);

#endif
