/* The table of all integrators (coordinator/integrate/integrator.h). */
#ifndef KILN_COORDINATOR_BAKE_INTEGRATORS_H
#define KILN_COORDINATOR_BAKE_INTEGRATORS_H

#include "coordinator/integrate/integrator.h"

/* The one of that name; NULL: there is none. */
const struct kiln_integrator *kiln_integrator_find(const char *name);
/* Whether an integrator has a role with this row in the table of phases. */
bool kiln_integrator_has_phase(const char *phase);

#endif
