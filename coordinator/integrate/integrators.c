#include <string.h>

#include "coordinator/integrate/cells/cells.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/integrate/radiosity/radiosity.h"
#include "coordinator/integrate/reference/reference.h"
#include "worker/base/memory.h"

#define NAME(name) #name,
#define STRUCT(name) &kiln_integrator_##name,

const char *const kiln_integrator_names[] = {KILN_METHOD_LIST(NAME) NULL};
static const struct kiln_integrator *const integrators[] = {KILN_METHOD_LIST(STRUCT) NULL};

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

int kiln_step_reports_reserve(struct kiln_step_reports *reports, size_t count, struct kiln_error *error)
{
    return kiln_grow(&reports->of, &reports->room, count, sizeof *reports->of, "the reports of the steps", error);
}

int kiln_integrate_outlook(const struct kiln_integrate_settings *settings, struct kiln_step_reports *reports,
                           const struct kiln_step *next, struct kiln_outlook *outlook, struct kiln_error *error)
{
    struct kiln_integrate_settings assumed = *settings;
    struct kiln_step step = *next;
    size_t count = reports->count;
    int status = KILN_OK;
    if (assumed.bounces < 0)
        assumed.bounces = (int64_t)next->bounce + KILN_BOUNCES_TO_COME;
    *outlook = (struct kiln_outlook){0, 0.0};
    do {
        status = kiln_step_reports_reserve(reports, count + 1, error);
        if (status != KILN_OK)
            return status;
        outlook->steps++;
        outlook->samples += (double)step.samples;
        reports->of[count++] = (struct kiln_step_report){.step = step};
    } while (kiln_steps_next(&assumed, reports->of, count, &step));
    return KILN_OK;
}
