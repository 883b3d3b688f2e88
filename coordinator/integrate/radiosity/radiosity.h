/* The integrator "radiosity": light bounces between pairs of patches (worker/pass/patches.h), or by rays along sets of
 * directions or to bright patches (worker/pass/directions.h). Direct light is computed as by "cells". Then all points
 * gather in lockstep, each bounce from the radiosity of all points in the one before, until the given number of bounces
 * or until less than 1e-5 of all light is left: the equal schedule of "cells". Alternatively patches send by their
 * unshot power (unshot.h). Kahl, "RTX Radiosity", 2023, chapter 4. */
#ifndef KILN_COORDINATOR_INTEGRATE_RADIOSITY_RADIOSITY_H
#define KILN_COORDINATOR_INTEGRATE_RADIOSITY_RADIOSITY_H

#include "coordinator/integrate/integrator.h"

extern const struct kiln_integrator kiln_integrator_radiosity;

#endif
