#include "coordinator/integrate/run/lockstep.h"

#include <math.h>
#include <stdio.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/integrate/run/repartition.h"
#include "coordinator/integrate/run/trial.h"
#include "coordinator/mpi/agree.h"

static const struct kiln_role *role_of(const struct kiln_lockstep *l, const struct kiln_step *step)
{
    return kiln_roles(l->params->settings).of[step->role];
}

static uint32_t take_threads(const struct kiln_integrate_params *p)
{
    struct kiln_backend_info info;
    kiln_backend_info(p->backend, &info);
    return info.take_threads != 0 && info.take_threads < p->threads ? info.take_threads : p->threads;
}

int kiln_lockstep_create(struct kiln_lockstep *l, const struct kiln_integrate_params *params,
                         struct kiln_solution *solution, struct kiln_error *error)
{
    *l = (struct kiln_lockstep){.params = params, .solution = solution};
    l->taker.ledger = &l->ledger;
    l->taker.threads = take_threads(params);
    l->batches = (struct kiln_batches){.params = params, .solution = solution, .work = &l->work, .taker = &l->taker};
    l->exchange = (struct kiln_radiosity_exchange){solution, params->control, params->trace, params->threads};
    l->integration = (struct kiln_integration){.communicator = params->communicator,
                                               .settings = params->settings,
                                               .solution = solution,
                                               .ledger = &l->ledger,
                                               .exchange = &l->exchange,
                                               .company = &l->company};
    l->saved = (struct kiln_saved){params, solution, &l->ledger, &l->work, &l->company};
    l->batches.company = &l->company;
    l->taker.company = &l->company;
    int status = kiln_ledger_create(&l->ledger, params->surface, kiln_luminance(params->emission->emitted), error);
    const struct kiln_companion_site site = {
        .params = params, .solution = solution, .batches = &l->batches, .taker = &l->taker, .saved = &l->saved};
    return status == KILN_OK ? kiln_company_create(&l->company, &site, error) : status;
}

void kiln_lockstep_release(struct kiln_lockstep *l)
{
    kiln_progress_reckon(l->params->progress, NULL, NULL);
    kiln_light_clock_release(&l->clock);
    kiln_company_destroy(&l->company);
    kiln_ledger_release(&l->ledger);
    kiln_taker_release(&l->taker);
    kiln_batches_release(&l->batches);
    kiln_step_work_release(&l->work);
}

/* ---- a step ---- */

static int add_report(struct kiln_lockstep *l, const struct kiln_step *step, struct kiln_error *error)
{
    struct kiln_step_reports *steps = &l->solution->report.steps;
    const int status = kiln_step_reports_reserve(steps, steps->count + 1, error);
    if (status == KILN_OK)
        steps->of[steps->count++] = (struct kiln_step_report){.step = *step};
    return status;
}

/* Collective. Begins the next step: adds its report, with all tile runs of this rank still to do. */
static int begin_step(struct kiln_lockstep *l, const struct kiln_step *step, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    int status = add_report(l, step, error);
    kiln_ledger_begin_step(&l->ledger);
    if (status == KILN_OK)
        status = kiln_step_work_begin(&l->work, p->surface->tile_run_count, error);
    if (status == KILN_OK)
        kiln_step_work_offer(&l->work, l->solution->own);
    kiln_control_meet(p->control);
    kiln_control_blocking(p->control, "between passes", 0.0);
    status = kiln_agree(p->communicator, status, error);
    kiln_control_blocking(p->control, NULL, 0.0);
    return status;
}

static void show_step(const struct kiln_lockstep *l, const struct kiln_step *step)
{
    const struct kiln_role *role = role_of(l, step);
    const bool in_parts = step->quantity == NULL && l->params->settings->parts > 1;
    char name[64], with_part[128];
    (void)snprintf(name, sizeof name, "%s %u", role->title, step->bounce);
    const char *text = role->numbered ? name : role->title;
    int length =
        snprintf(with_part, sizeof with_part, "%s, part %u of %d", text, step->part % KILN_PARTS + 1, (int)KILN_PARTS);
    if (step->part >= KILN_PARTS)
        (void)snprintf(with_part + length, sizeof with_part - (size_t)length, ", round %u",
                       step->part / KILN_PARTS + 1);
    kiln_progress_phase(l->params->progress, in_parts ? with_part : text, l->params->surface->count);
    if (l->work.points_done > 0)
        kiln_progress_advance(l->params->progress, l->work.points_done);
    kiln_control_begin(l->params->control, text);
}

/* Collective. Batches until the step is done, with checkpoints when they are asked for. */
static int run_batches(struct kiln_lockstep *l, struct kiln_error *error)
{
    for (;;) {
        enum kiln_event event;
        int status = kiln_batches_run(&l->batches, &event, error);
        if (event == KILN_EVENT_STOP)
            return kiln_save_and_stop(&l->saved, false, error);
        if (event == KILN_EVENT_DONE && status == KILN_OK)
            return kiln_company_complete(&l->company, error);
        if (event != KILN_EVENT_SAVE)
            return status;
        status = kiln_save(&l->saved, false, error);
        if (status != KILN_OK)
            return status;
    }
}

/* Collective. Adds up over the ranks. */
static int end_step(struct kiln_lockstep *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    struct kiln_integrate_report *r = &l->solution->report;
    kiln_control_blocking(p->control, "adding up a pass", 0.0);
    int status;
    KILN_TRY(kiln_ledger_end_step(&l->ledger, p->communicator, &kiln_solution_step(l->solution)->energy, error));
    if (kiln_solution_step(l->solution)->step.quantity == NULL)
        KILN_TRY(p->settings->integrator->end_step(&l->integration, &r->steps, error));
    KILN_TRY(kiln_company_after_step(&l->company, l->ledger.unit, error));
end:
    kiln_control_blocking(p->control, NULL, 0.0);
    return status;
}

/* Collective. Runs the step last reported. The report receives this rank's time and all ranks' energies. */
static int run_step(struct kiln_lockstep *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    struct kiln_step_report *report = kiln_solution_step(l->solution);
    kiln_rank_data_lend(l->solution->own, p->surface);
    kiln_light_clock_step(&l->clock);
    int status = kiln_company_before_step(&l->company, error);
    if (status != KILN_OK)
        return status;
    l->taker.taking = (struct kiln_taking){.settings = p->settings,
                                           .step = &report->step,
                                           .fields = p->fields,
                                           .scene = p->backend->params.scene,
                                           .radiosity = l->solution->radiosity,
                                           .scale = kiln_radiosity_allgather_scale(l->solution->allgather),
                                           .unit = l->ledger.unit};
    l->taker.may_lack = report->step.pass->reads_radiosity && l->solution->own->lacking != NULL &&
                        kiln_radiosity_allgather_reach(l->solution->allgather) != NULL;
    show_step(l, &report->step);
    kiln_radiosity_allgather_begin(l->solution->allgather);
    const double start = MPI_Wtime();
    kiln_batches_begin(&l->batches, report, error);
    status = run_batches(l, error);
    if (status != KILN_OK)
        kiln_radiosity_allgather_abandon(l->solution->allgather);
    report->given += kiln_work_queue_returned(l->solution->own->queue);
    kiln_trace_add(p->trace, KILN_TRACE_PASS, role_of(l, &report->step)->title, start, MPI_Wtime(),
                   (int64_t)p->surface->count);
    return status == KILN_OK ? end_step(l, error) : status;
}

/* ---- all steps ---- */

/* Collective, at the begin of a step and after the last one. Saves a checkpoint if one is due, and stops on request. */
static int save_between(struct kiln_lockstep *l, bool finished, struct kiln_error *error)
{
    switch (kiln_control_between(l->params->control, kiln_save_bytes(&l->saved))) {
    case KILN_EVENT_SAVE:
        return kiln_save(&l->saved, finished, error);
    case KILN_EVENT_STOP:
        return kiln_save_and_stop(&l->saved, finished, error);
    case KILN_EVENT_NONE:
    case KILN_EVENT_FAIL:
    case KILN_EVENT_DONE:
        break;
    }
    return KILN_OK;
}

/* Announces that direct light is complete. This is so when the first step of the last part gathers radiosity. */
static void tell_of_direct(const struct kiln_integrate_params *p, const struct kiln_step *step)
{
    const struct kiln_integrate_settings *s = p->settings;
    const bool last = s->parts <= 1 || (step->part + 1 == s->parts && !kiln_has_rounds(s));
    if (p->beside != NULL && last && step->quantity == NULL && step->pass->reads_radiosity)
        p->beside->direct(p->beside->context);
}

/* Collective. Prepares a step, that is, exchanges its input and repartitions the points; then runs it. */
static int do_step(struct kiln_lockstep *l, const struct kiln_step *step, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const bool first = l->solution->report.steps.count == 0;
    int status = KILN_OK;
    struct kiln_step_report *last = first ? NULL : kiln_solution_step(l->solution);
    if (step->quantity == NULL)
        KILN_TRY(p->settings->integrator->begin_step(&l->integration, last, step, error));
    else if (step->pass->reads_radiosity)
        kiln_exchange_total_radiosity(&l->exchange, last);
    const bool may_move = p->ranks > 1 && l->may_repartition;
    if (!first && may_move && l->work.measured && kiln_companion_answering(p->companions, &last->step) == NULL)
        KILN_TRY(kiln_repartition(p, l->solution, &l->company, step, error));
    if (first && may_move && !l->company.whole_batches)
        KILN_TRY(kiln_trial_run(p, l->solution, &l->company, step, error));
    KILN_TRY(begin_step(l, step, error));
    tell_of_direct(p, step);
    if (!first)
        KILN_TRY(save_between(l, false, error));
    KILN_TRY(run_step(l, error));
end:
    return status;
}

int kiln_lockstep_run(struct kiln_lockstep *l, bool restored, bool finished, struct kiln_error *error)
{
    const struct kiln_integrate_settings *settings = l->params->settings;
    const struct kiln_step_reports *steps = &l->solution->report.steps;
    struct kiln_step step;
    int status = KILN_OK;
    l->clock.settings = settings;
    l->clock.steps = steps;
    l->clock.rounds = l->params->rounds;
    kiln_progress_reckon(l->params->progress, kiln_light_clock_left, &l->clock);
    if (restored && !finished) {
        struct kiln_step_report *report = kiln_solution_step(l->solution);
        if (report->step.pass->reads_radiosity)
            kiln_exchange_radiosity(&l->exchange, KILN_EXCHANGE_IN_PLACE, report);
        if (report->step.pass->reads_radiosity)
            kiln_company_exchange(&l->company, true);
        status = run_step(l, error);
    }
    while (status == KILN_OK && !finished && kiln_steps_next(settings, steps->of, steps->count, &step))
        status = do_step(l, &step, error);
    return status == KILN_OK && !finished ? save_between(l, true, error) : status;
}
