/* Kept transport in memory: for each step the rows of this rank's points (worker/pass/resident_rows.h), read once from
 * the bake's folder. Rows missing there are traced when the step is first gathered, and kept too: ray hits do not
 * depend on light.
 *
 * The runner of states (states.h) accesses kept transport only by kiln_resident_step. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_RESIDENT_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_RESIDENT_H

#include "coordinator/integrate/integrate.h"
#include "worker/pass/resident_rows.h"

struct kiln_resident;

/* Not collective. Borrows the parameters, whose transport replays. KILN_SYSTEM. */
int kiln_resident_create(struct kiln_resident **resident, const struct kiln_integrate_params *params,
                         struct kiln_error *error);
void kiln_resident_destroy(struct kiln_resident **resident);

/* Returns the rows of a gather step, ready for all own tile runs marked in `wanted` (one byte each). The backend looks
 * up or traces missing rows, with the radiosity of `solution`: any solution that has the own points. Not collective.
 * KILN_BAD_INPUT: the file is damaged, or of another bake. */
int kiln_resident_step(struct kiln_resident *resident, const struct kiln_solution *solution,
                       const struct kiln_step *step, const uint8_t *wanted, const struct kiln_resident_rows **rows,
                       struct kiln_error *error);

/* Converts rows to the form of the backends (kiln_backend_set_rows, kiln_backend_replay). */
struct kiln_rows *kiln_resident_for_backend(struct kiln_resident *resident, const struct kiln_resident_rows *rows);

/* Counts of this rank: rays read from the folder, rays traced, bytes kept in memory, and the time spent on getting
 * them: s, and s of the processor. */
struct kiln_resident_counts {
    uint64_t read, traced, bytes;
    double seconds, processor;
};
struct kiln_resident_counts kiln_resident_counts(const struct kiln_resident *resident);

#endif
