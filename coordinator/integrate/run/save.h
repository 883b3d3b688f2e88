/* Checkpoints of the lockstep runner (save.c). Within a step they store the reports of all steps, the ledger's sums,
 * the own points' data, the radiosity that is gathered, and the set of computed points. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_SAVE_H
#define KILN_COORDINATOR_INTEGRATE_RUN_SAVE_H

#include "coordinator/integrate/company.h"
#include "coordinator/integrate/run/step_work.h"

/* State that is saved and restored. All borrowed. */
struct kiln_saved {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    struct kiln_ledger *ledger;
    struct kiln_step_work *work;
    struct kiln_company *company; /* whose arrays each companion reads itself; NULL: none */
};

/* Collective. Writes a checkpoint within the last reported step or, with `finished`, after the last step, when
 * radiosities and groups are no longer needed. Does nothing if the integration has no checkpoint. */
int kiln_save(const struct kiln_saved *saved, bool finished, struct kiln_error *error);
/* Collective. Writes a checkpoint, if there is one, and returns KILN_STOPPED with its message, or the error. */
int kiln_save_and_stop(const struct kiln_saved *saved, bool finished, struct kiln_error *error);
/* Collective. Writes a checkpoint of a complete solution, with additional blocks of the caller. */
int kiln_save_solution(struct kiln_solution *solution, const struct kiln_integrate_params *params,
                       const struct kiln_array_range *more, size_t count, struct kiln_error *error);
/* Collective. Restores the state from the open generation, without the radiosity of other ranks' points. */
int kiln_restore(const struct kiln_saved *saved, bool *finished, struct kiln_error *error);
/* Bytes of a checkpoint, sum of all ranks. */
uint64_t kiln_save_bytes(const struct kiln_saved *saved);

#endif
