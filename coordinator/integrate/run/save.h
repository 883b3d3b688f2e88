/* Checkpoints of the lockstep runner (save.c). What is saved of a step under way: the reports of all steps,
 * the ledger's sums, the own points' data, the radiosity that is gathered from, and which points are done. */
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
    struct kiln_company *company; /* whose blocks each companion reads itself; NULL: none */
};

/* Collective. Writes a checkpoint: at any time within the last reported step, or with `finished` after the last (when
 * radiosities and groups are of no more use). Does nothing where the integration has no checkpoint. */
int kiln_save(const struct kiln_saved *saved, bool finished, struct kiln_error *error);
/* Collective. Saves, where there is a checkpoint, and returns KILN_STOPPED with its sentence, or why it cannot. */
int kiln_save_and_stop(const struct kiln_saved *saved, bool finished, struct kiln_error *error);
/* Collective. Writes a checkpoint of a solution that is complete, with more blocks of the caller's. */
int kiln_save_solution(struct kiln_solution *solution, const struct kiln_integrate_params *params,
                       const struct kiln_block *more, size_t count, struct kiln_error *error);
/* Collective. Takes over the open generation: everything but the radiosity of other ranks' points. */
int kiln_restore(const struct kiln_saved *saved, bool *finished, struct kiln_error *error);
/* Bytes of a checkpoint, of all ranks. */
uint64_t kiln_save_bytes(const struct kiln_saved *saved);

#endif
