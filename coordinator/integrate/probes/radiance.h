/* Radiance probes of a bake whose gather rays end at a range (Vandersanden, "Radiance Cells", 2023, chapters 3.4 to
 * 3.7): their positions, the probes that each surface point sees, and their radiance before each gather step.
 *
 * Each rank gathers a contiguous range of the probes, then all ranks receive all probes. A probe's data depends only on
 * the seed, the step and the probe, so the number of ranks changes no bit.
 *
 * Probes in geometry. A probe is inside something if its rays meet backs of single-sided surfaces in more than a
 * quarter of all directions. It moves, within its box of the grid and less than half a spacing along each axis, to the
 * place with the fewest backs. If these are still more than a quarter, the probe is off: no point uses it.
 *
 * No leaks. A point uses only probes that it sees, as tested with rays once, before the first gather step. This is
 * exact for walls of any thickness. Some points trace unlimited rays instead, which is not biased: those that see no
 * probe, and those whose visible probes all are farther than both the range and the surroundings of the point
 * (radiance_sight.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_H
#define KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_H

#include "coordinator/integrate/run/save.h"

struct kiln_radiance;

/* All borrowed; not collective. KILN_USAGE, the same on all ranks, for more probes than there may be; KILN_SYSTEM.
 * Destroy with kiln_radiance_destroy. */
int kiln_radiance_create(struct kiln_radiance **radiance, const struct kiln_integrate_params *params,
                         struct kiln_solution *solution, const struct kiln_saved *saved, struct kiln_error *error);
/* Destroys the probes, also in the backend. NULL is accepted. */
void kiln_radiance_destroy(struct kiln_radiance **radiance);

/* Collective, before the step last reported, which gathers from solution->radiosity, is computed or resumed. Computes
 * the probes' radiance from it and passes the probes to the backend; the first call of a run places them. The points'
 * words are in the field near_probes and in the surface of the params. Writes a checkpoint when one is due.
 * KILN_STOPPED, with a new generation written, on a request to stop. */
int kiln_radiance_update(struct kiln_radiance *radiance, struct kiln_error *error);

/* Collective, after all steps. Sums the rays of probes for the report. */
void kiln_radiance_end(const struct kiln_radiance *radiance);

#endif
