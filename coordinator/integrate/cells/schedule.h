/* Which steps a bake by "cells" has.
 *
 * Lean: direct light; bounces with few samples, each of which gathers the radiosity of the one before; one final gather
 * with many samples, which reads the radiosity of direct light and all bounces summed up (with a geometric tail, where
 * that is asked for) and replaces what the bounces have found. The noise of the cheap bounces averages out in it. With
 * a number of bounces N given there are N - 1 bounces and the final gather; without, bounces go on until the tail is
 * good enough.
 *
 * Equal: direct light; bounces with many samples, whose irradiance counts as it is. Without a number given they go on
 * until what is left is below 1e-5 of all. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_SCHEDULE_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_SCHEDULE_H

#include "coordinator/integrate/settings.h"
#include "coordinator/integrate/step.h"

enum { KILN_BOUNCES_ALL = 254 };    /* at most so many where their number is not given */
#define KILN_TAIL_RATIO_MOST 0.9999 /* of a bounce to the one before, that a tail is reckoned with */

/* kiln_integrator.next */
bool kiln_cells_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step);

/* Reflected power of step `i` over that of the one before, luminance; 0 where the latter has none. */
double kiln_cells_ratio(const struct kiln_step_report *reports, size_t i);

/* Whether the lean schedule adds a geometric tail to the bounces. */
static inline bool kiln_cells_adds_tail(const struct kiln_integrate_settings *settings)
{
    return settings->tail || settings->bounces < 0;
}

#endif
