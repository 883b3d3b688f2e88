/* The integrators "path", "bdpt" and "vcm": direct light as by "cells", then one step that traces paths from every
 * surface point for all other light (worker/pass/reference.h). They gather and exchange no radiosity, so they serve as
 * a reference for bakes by "cells". All their light besides direct light is indirect light, caustics included. */
#ifndef KILN_COORDINATOR_INTEGRATE_REFERENCE_REFERENCE_H
#define KILN_COORDINATOR_INTEGRATE_REFERENCE_REFERENCE_H

#include "coordinator/integrate/integrator.h"

extern const struct kiln_integrator kiln_integrator_path, kiln_integrator_bdpt, kiln_integrator_vcm;

#endif
