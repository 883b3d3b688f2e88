/* The integrator "radiosity": bounces between patches, pair by pair (worker/pass/patches.h), or by rays that go by sets
 * of directions or to bright patches (worker/pass/directions.h). Direct light is as "cells"
 * has it; then the points gather in lockstep, bounce after bounce, each from what all points have sent in the one
 * before, until the given number of bounces is done or less than 1e-5 of all light is left: the equal schedule of
 * "cells"; or patches send by their unshot power (unshot.h). Kahl, "RTX Radiosity", 2023, chapter 4. */
#ifndef KILN_COORDINATOR_INTEGRATE_RADIOSITY_RADIOSITY_H
#define KILN_COORDINATOR_INTEGRATE_RADIOSITY_RADIOSITY_H

#include "coordinator/integrate/integrator.h"

extern const struct kiln_integrator kiln_integrator_radiosity;

#endif
