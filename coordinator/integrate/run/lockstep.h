/* The lockstep runner executes the integrator's steps one after the other, on all ranks together. It owns all data that
 * a step needs while it runs. It depends on no particular integrator, companion or backend. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_LOCKSTEP_H
#define KILN_COORDINATOR_INTEGRATE_RUN_LOCKSTEP_H

#include "coordinator/integrate/light_left.h"
#include "coordinator/integrate/run/batches.h"
#include "coordinator/integrate/run/radiosity_exchange.h"
#include "coordinator/integrate/run/save.h"

struct kiln_lockstep {
    /* borrowed */
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    /* own */
    struct kiln_ledger ledger;
    struct kiln_step_work work;
    struct kiln_taker taker;
    struct kiln_batches batches;
    struct kiln_radiosity_exchange exchange;
    struct kiln_integration integration; /* for the integrator */
    struct kiln_saved saved;             /* for checkpoints */
    struct kiln_company company;
    struct kiln_light_clock clock; /* of the steps, for the time left */
    bool may_repartition;          /* points may be redistributed; the same on all ranks */
};

/* Not collective. Initializes the runner. Its parts point to each other, so it must not be copied. KILN_SYSTEM. Release
 * with kiln_lockstep_release, in any case. */
int kiln_lockstep_create(struct kiln_lockstep *lockstep, const struct kiln_integrate_params *params,
                         struct kiln_solution *solution, struct kiln_error *error);
void kiln_lockstep_release(struct kiln_lockstep *lockstep);

/* Collective. Runs all remaining steps: with `restored` first the rest of the step within which the checkpoint was
 * made; with `finished` none. */
int kiln_lockstep_run(struct kiln_lockstep *lockstep, bool restored, bool finished, struct kiln_error *error);

#endif
