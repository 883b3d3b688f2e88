/* The integrators "path", "bdpt" and "vcm": direct light as "cells" has it, then one step in which paths from every
 * surface point bring all other light (worker/pass/reference.h). Nothing is gathered and nothing exchanged, so a bake
 * by "cells" can be held against them. What they find beside direct light is indirect light, caustics among it. */
#ifndef KILN_COORDINATOR_INTEGRATE_REFERENCE_REFERENCE_H
#define KILN_COORDINATOR_INTEGRATE_REFERENCE_REFERENCE_H

#include "coordinator/integrate/integrator.h"

extern const struct kiln_integrator kiln_integrator_path, kiln_integrator_bdpt, kiln_integrator_vcm;

#endif
