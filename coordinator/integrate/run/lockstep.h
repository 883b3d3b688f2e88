/* The lockstep runner: step after step, as the integrator says, on all ranks together. It owns what a step needs while
 * it runs; it knows no integrator and no companion by name, and nothing of what a
 * backend is made of. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_LOCKSTEP_H
#define KILN_COORDINATOR_INTEGRATE_RUN_LOCKSTEP_H

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
    bool may_repartition; /* points may be distributed anew; the same on all ranks */
};

/* Not collective. Zeroes and fills in; the own parts point to each other, so it must not be copied. KILN_SYSTEM.
 * Release with kiln_lockstep_release, in any case. */
int kiln_lockstep_create(struct kiln_lockstep *lockstep, const struct kiln_integrate_params *params,
                         struct kiln_solution *solution, struct kiln_error *error);
void kiln_lockstep_release(struct kiln_lockstep *lockstep);

/* Collective. Runs the rest of the step that the checkpoint was within, with `restored`, and all that come after it;
 * with `finished` there are none. */
int kiln_lockstep_run(struct kiln_lockstep *lockstep, bool restored, bool finished, struct kiln_error *error);

#endif
