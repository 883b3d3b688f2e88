#include <string.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/quantity.h"

#define STRUCT(name) &kiln_quantity_##name,
static const struct kiln_quantity *const quantities[] = {KILN_QUANTITY_LIST(STRUCT)};
enum { QUANTITIES = sizeof quantities / sizeof *quantities };

bool kiln_steps_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step)
{
    size_t light = 0, wanted = 0; /* the integrator's steps come first */
    while (light < count && reports[light].step.quantity == NULL)
        light++;
    if (light == count && kiln_parts_next(settings, reports, count, step))
        return true;
    for (size_t q = 0; q < QUANTITIES; q++) {
        if (!quantities[q]->wanted(settings) || wanted++ < count - light)
            continue;
        *step = (struct kiln_step){.quantity = quantities[q],
                                   .role = settings->integrator->role_count + (uint32_t)(count - light)};
        quantities[q]->make_step(settings, step);
        step->with = settings->seen_only ? KILN_WITH(seen) : 0;
        return true;
    }
    return false;
}

struct kiln_roles kiln_roles(const struct kiln_integrate_settings *settings)
{
    struct kiln_roles roles = {.count = 0};
    for (uint32_t r = 0; r < settings->integrator->role_count; r++)
        roles.of[roles.count++] = &settings->integrator->roles[r];
    for (size_t q = 0; q < QUANTITIES; q++)
        if (quantities[q]->wanted(settings))
            roles.of[roles.count++] = &quantities[q]->role;
    return roles;
}

bool kiln_is_phase_of_steps(const char *phase)
{
    for (size_t q = 0; q < QUANTITIES; q++)
        if (strcmp(quantities[q]->role.phase, phase) == 0)
            return true;
    return kiln_integrator_has_phase(phase);
}
