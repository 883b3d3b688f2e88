/* Radiance probes of a bake whose gather rays end at a range (Vandersanden, "Radiance Cells", 2023, chapters 3.4 to
 * 3.7): where they are, which of them each surface point sees, and their radiance before each step that gathers.
 *
 * Each rank gathers a contiguous range of the probes, and all ranks then have all of them: a probe's data is a function
 * of the seed, the step and the probe alone, so the number of ranks changes no bit.
 *
 * Probes in geometry. A probe whose rays meet backs of single-sided surfaces in more than a quarter of all directions
 * is inside something. It moves within its box of the grid, less than half a spacing along each axis, to where the
 * fewest backs are; where that is still more than a quarter, it is off, and nobody asks it.
 *
 * No leaks. A point asks only probes that it sees: rays say so, once, before the first step that gathers. They are
 * exact for walls of any thickness. A point that sees none, or none but such as are farther than the range and than
 * what is around the point (radiance_sight.h), traces its rays without an end, which is not biased. */
#ifndef KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_H
#define KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_H

#include "coordinator/integrate/run/save.h"

struct kiln_radiance;

/* All borrowed; not collective. KILN_USAGE, the same on all ranks, for more probes than there may be; KILN_SYSTEM.
 * Destroy with kiln_radiance_destroy. */
int kiln_radiance_create(struct kiln_radiance **radiance, const struct kiln_integrate_params *params,
                         struct kiln_solution *solution, const struct kiln_saved *saved, struct kiln_error *error);
/* The backend forgets the probes. NULL is accepted. */
void kiln_radiance_destroy(struct kiln_radiance **radiance);

/* Collective. Before the step last reported, which gathers from solution->radiosity, is computed or gone on with: gives
 * the probes its radiance, and the backend the probes; the first call of a run places them first. The points' words
 * stand in the field near_probes and in the surface of the params. Writes a checkpoint when one is due. KILN_STOPPED,
 * with a new generation written, when something asked to stop. */
int kiln_radiance_update(struct kiln_radiance *radiance, struct kiln_error *error);

/* Collective. All steps are done: adds up the rays of probes for the report. */
void kiln_radiance_end(const struct kiln_radiance *radiance);

#endif
