/* Kept transport in memory: of each step the rows of this rank's points (worker/pass/resident_rows.h), read from the
 * bake's folder once. A step whose rows are not kept there, or not all, has the rest traced when it is first gathered,
 * and these stay too: what rays meet hangs on no light.
 *
 * kiln_resident_step is all that the runner of states (states.h) knows of what is kept. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_RESIDENT_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_RESIDENT_H

#include "coordinator/integrate/integrate.h"
#include "worker/pass/resident_rows.h"

struct kiln_resident;

/* Not collective. Borrows the parameters, whose transport replays. KILN_SYSTEM. */
int kiln_resident_create(struct kiln_resident **resident, const struct kiln_integrate_params *params,
                         struct kiln_error *error);
void kiln_resident_destroy(struct kiln_resident **resident);

/* The rows of a gather step, all those ready for which `wanted` is true (one byte an own tile run). What is not ready
 * is looked up or traced by the backend, with the radiosity of `solution`: any that has the own points. Not
 * collective. KILN_BAD_INPUT: the file is damaged, or of another bake. */
int kiln_resident_step(struct kiln_resident *resident, const struct kiln_solution *solution,
                       const struct kiln_step *step, const uint8_t *wanted, const struct kiln_resident_rows **rows,
                       struct kiln_error *error);

/* The same rows as backends have them (kiln_backend_set_rows, kiln_backend_replay). */
struct kiln_rows *kiln_resident_for_backend(struct kiln_resident *resident, const struct kiln_resident_rows *rows);

/* Rays that were read from the folder, that had to be traced, the bytes of all that is kept here, and what getting it
 * has cost so far: s, and s of the processor. Of this rank. */
struct kiln_resident_counts {
    uint64_t read, traced, bytes;
    double seconds, processor;
};
struct kiln_resident_counts kiln_resident_counts(const struct kiln_resident *resident);

#endif
