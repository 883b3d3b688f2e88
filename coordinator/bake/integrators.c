#include "coordinator/bake/integrators.h"

#include <string.h>

#include "coordinator/integrate/cells/cells.h"
#include "coordinator/job/choices.h"

#define STRUCT(name) &kiln_integrator_##name,
static const struct kiln_integrator *const integrators[] = {KILN_INTEGRATOR_LIST(STRUCT) NULL};

const struct kiln_integrator *kiln_integrator_find(const char *name)
{
    for (size_t i = 0; integrators[i] != NULL; i++)
        if (strcmp(integrators[i]->name, name) == 0)
            return integrators[i];
    return NULL;
}

bool kiln_integrator_has_phase(const char *phase)
{
    for (size_t i = 0; integrators[i] != NULL; i++)
        for (uint32_t r = 0; r < integrators[i]->role_count; r++)
            if (strcmp(integrators[i]->roles[r].phase, phase) == 0)
                return true;
    return false;
}
