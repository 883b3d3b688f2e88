#include "coordinator/bake/reckon/steps.h"

#include "coordinator/integrate/companion.h"
#include "worker/base/memory.h"

/* The kind of a step, a new one where none fits. */
static int find_kind(struct kiln_planned_steps *steps, struct kiln_planned_step *planned, struct kiln_error *error)
{
    const struct kiln_step *step = &planned->step;
    uint32_t k = 0;
    while (k < steps->kind_count &&
           (steps->kinds[k].pass != step->pass || steps->kinds[k].parameters != step->parameters ||
            steps->kinds[k].samples != step->samples || steps->kinds[k].with != step->with))
        k++;
    planned->kind = k;
    if (k < steps->kind_count)
        return KILN_OK;
    if (k == KILN_COST_KINDS_MAX)
        return kiln_fail(error, KILN_SYSTEM, "this bake has steps of more than %d kinds, which cannot be planned",
                         KILN_COST_KINDS_MAX);
    steps->kinds[steps->kind_count++] = (struct kiln_cost_kind){
        step->pass,   step->parameters, step->samples,
        step->stream, step->with,       kiln_companion_answering(kiln_companions, step) != NULL};
    return KILN_OK;
}

static int add_step(struct kiln_planned_steps *steps, const struct kiln_step *step, struct kiln_error *error)
{
    int status = kiln_grow(&steps->of, &steps->room, steps->count + 1, sizeof *steps->of, "the planned steps", error);
    if (status != KILN_OK)
        return status;
    struct kiln_planned_step *planned = &steps->of[steps->count++];
    *planned = (struct kiln_planned_step){.step = *step};
    return find_kind(steps, planned, error);
}

/* Sets the outlook of each step from the planned steps themselves, for a given number of bounces. */
static void look_back(struct kiln_planned_steps *steps)
{
    struct kiln_outlook outlook = {0, 0.0};
    for (size_t i = steps->count; i-- > 0;) {
        outlook.steps++;
        outlook.samples += (double)steps->of[i].step.samples;
        steps->of[i].outlook = outlook;
    }
}

/* Sets the outlook of each step as a bake would estimate it, for a number of bounces that is not given. */
static int look_ahead(struct kiln_planned_steps *steps, const struct kiln_integrate_settings *settings,
                      struct kiln_step_reports *reports, struct kiln_error *error)
{
    int status = KILN_OK;
    for (reports->count = 0; reports->count < steps->count && status == KILN_OK; reports->count++) {
        struct kiln_planned_step *planned = &steps->of[reports->count];
        status = kiln_integrate_outlook(settings, reports, &planned->step, &planned->outlook, error);
    }
    return status;
}

int kiln_planned_steps_make(struct kiln_planned_steps *steps, const struct kiln_integrate_settings *settings,
                            uint32_t typical, struct kiln_error *error)
{
    struct kiln_integrate_settings assumed = *settings;
    struct kiln_step_reports reports = {NULL, 0, 0};
    struct kiln_step step;
    int status = KILN_OK;
    *steps = (struct kiln_planned_steps){.roles = kiln_roles(settings)};
    assumed.bounces = settings->bounces < 0 ? typical : settings->bounces;
    while (status == KILN_OK && kiln_steps_next(&assumed, reports.of, reports.count, &step)) {
        status = kiln_step_reports_reserve(&reports, reports.count + 1, error);
        if (status == KILN_OK)
            reports.of[reports.count++] = (struct kiln_step_report){.step = step};
        if (status == KILN_OK)
            status = add_step(steps, &step, error);
    }
    if (status == KILN_OK && settings->bounces < 0)
        status = look_ahead(steps, settings, &reports, error);
    else
        look_back(steps);
    kiln_free(&reports.of);
    return status;
}

void kiln_planned_steps_release(struct kiln_planned_steps *steps) { kiln_free(&steps->of); }
