/* Checkpoints of the lockstep runner (save.c). What is saved of a step under way: the reports of all steps,
 * the ledger's sums, the own points' data, the radiosity that is gathered from, and which points are done. */
#ifndef KILN_COORDINATOR_INTEGRATE_SAVE_H
#define KILN_COORDINATOR_INTEGRATE_SAVE_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/step_work.h"

struct kiln_landing;

/* What is saved and restored. All borrowed. */
struct kiln_saved {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    struct kiln_ledger *ledger;
    struct kiln_step_work *work;
    struct kiln_landing *landing; /* restored by itself (land.h); NULL: no step lands */
};

/* Collective. Writes a checkpoint: at any time within the last reported step, or with `finished` after the last (when
 * radiosities and groups are of no more use). Does nothing where the integration has no checkpoint. */
int kiln_save(const struct kiln_saved *saved, bool finished, struct kiln_error *error);
/* Collective. Saves, where there is a checkpoint, and returns KILN_STOPPED with its sentence, or why it cannot. */
int kiln_save_and_stop(const struct kiln_saved *saved, bool finished, struct kiln_error *error);
/* Collective. Takes over the open generation: everything but the radiosity of other ranks' points. */
int kiln_restore(const struct kiln_saved *saved, bool *finished, struct kiln_error *error);
/* Bytes of a checkpoint, of all ranks. */
uint64_t kiln_save_bytes(const struct kiln_saved *saved);

#endif
