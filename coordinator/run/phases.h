/* Phase timer: measures the wall-clock time and the processor time of all threads for each phase of a run on this rank,
 * and gathers the times of all ranks. */
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
    double processor[KILN_PHASES_MAX]; /* s of all threads; 0 for a phase that was measured elsewhere */
    size_t count;                      /* phases so far */
    size_t present;                    /* index of the present phase */
    double processor_since;            /* s of the process when the present phase began */
    double since;                      /* MPI_Wtime() when the present phase began; 0: there is none */
    double begin;                      /* MPI_Wtime() when the run began */
    struct kiln_trace *trace;          /* borrowed; NULL: none */
    struct kiln_watchdog *watchdog;    /* gets the present phase; borrowed; NULL: none */
};

/* Ends the present phase and begins, or resumes, the one called `name`; with NULL none begins. All ranks must begin the
 * same phases for the first time in the same order. Not collective. */
void kiln_phase(struct kiln_phases *phases, const char *name);
/* Adds time to a phase that was measured elsewhere. */
void kiln_phase_add(struct kiln_phases *phases, const char *name, double seconds);
/* Moves `seconds` of the ended phase `whole` to the phase `part`, and a proportional share of its processor time. */
void kiln_phase_part(struct kiln_phases *phases, const char *whole, const char *part, double seconds);
/* Adds the phase "other" with the time of the run that belongs to no phase, so that the phases of a rank add up to its
 * time. `before`: seconds of earlier runs of the same bake, whose phases were added with kiln_phase_add. */
void kiln_phase_rest(struct kiln_phases *phases, double before);

/* Collective. Returns on rank 0 an array of {name, seconds: {min, avg, max}, processor_seconds, imbalance, per_rank:
 * []}, elsewhere NULL. processor_seconds is the sum over the ranks, null if the phase was measured elsewhere; imbalance
 * is max / avg - 1. `all`: on rank 0, room for KILN_PHASES_MAX values of each rank. */
json_t *kiln_phases_json(const struct kiln_phases *phases, MPI_Comm communicator, double *all);

#endif
