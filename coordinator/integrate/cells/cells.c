#include "coordinator/integrate/cells/cells.h"

#include <string.h>

#include "coordinator/integrate/cells/adapt.h"
#include "coordinator/integrate/cells/late.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/cells/tail.h"
#include "coordinator/integrate/cells/take.h"
#include "coordinator/integrate/cells/tile_error.h"
#include "coordinator/integrate/company.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/run/radiosity_exchange.h"
#include "worker/pass/direct.h"
#include "worker/pass/gather.h"
#include "worker/pass/guided.h"

/* in the order of KILN_CELLS_DIRECT, ... */
static const struct kiln_role roles[] = {
    {.kind = "direct", .total = "direct", .title = "direct light", .phase = "direct light"},
    {.kind = "bounce", .total = "bounces", .title = "bounce", .phase = "bounces", .numbered = true},
    {.kind = "final", .total = "final", .title = "final gather", .phase = "final gather"},
    {.kind = "pilot", .total = "pilot", .title = "direct light, pilot", .phase = "direct light"},
    {.kind = "caustic", .total = "caustics", .title = "caustics", .phase = "caustics", .optional = true}};

/* Starts a light group's sum with its direct light. */
static void begin_with_direct(const struct kiln_rank_data *own)
{
    const uint64_t count = 3 * own->surface.count;
#pragma omp parallel for schedule(static)
    for (uint64_t i = 0; i < count; i++)
        own->sum[i] = own->direct[i];
}

static int begin_step(struct kiln_integration *in, struct kiln_step_report *last, const struct kiln_step *step,
                      struct kiln_error *error)
{
    const struct kiln_rank_data *own = in->solution->own;
    if (step->role == KILN_CELLS_DIRECT) {
        kiln_ledger_forget_groups(in->ledger);
        kiln_late_reset(own);
        if (own->surface.guide != NULL && !kiln_part_goes_on(own, step))
            memset(own->surface.guide, 0, KILN_GUIDE_FLOATS * own->surface.count * sizeof *own->surface.guide);
    }
    if (step->bounce == 0)
        return KILN_OK;
    if (in->settings->schedule == KILN_SCHEDULE_EQUAL) {
        if (step->bounce == 1)
            kiln_company_each_light(in->company, begin_with_direct);
        if (step->bounce == 1) /* from now on the sum is of irradiance, and of bounces only */
            memset(own->sum, 0, 3 * own->surface.count * sizeof *own->sum);
        in->solution->report.bounces = step->bounce;
    } else if (step->role == KILN_CELLS_FINAL && kiln_part_goes_on(own, step)) {
        kiln_part_pack(own, step);
    } else if (step->role == KILN_CELLS_FINAL) {
        if (kiln_cells_adds_tail(in->settings))
            kiln_tail_add(in);
        kiln_cells_pack_sum(own);
        kiln_company_each_light(in->company, kiln_cells_pack_sum);
        in->solution->report.bounces = step->bounce;
    }
    const bool late = kiln_late_is(step);
    const int status = late ? kiln_late_choose(in, step->samples, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    const bool compact = last->step.compact && step->role == KILN_CELLS_BOUNCE;
    kiln_exchange_radiosity(in->exchange, compact ? KILN_EXCHANGE_NEXT_COMPACT : KILN_EXCHANGE_NEXT, last);
    kiln_company_exchange(in->company, false);
    if (late) {
        kiln_late_clear(own);
        kiln_company_each_light(in->company, kiln_late_clear);
    }
    return KILN_OK;
}

static int end_step(struct kiln_integration *in, struct kiln_step_reports *reports, struct kiln_error *error)
{
    struct kiln_step_report *last = &reports->of[reports->count - 1];
    const struct kiln_step_reports part = kiln_part_reports(reports);
    const struct kiln_rank_data *own = in->solution->own;
    const size_t first = kiln_cells_first(in->settings);
    if (last->step.role == KILN_CELLS_PILOT)
        return kiln_adapt_samples(in, in->settings->samples_direct - last->step.samples, error);
    if (kiln_part_goes_on(own, &last->step))
        return KILN_OK;
    if (in->settings->bounces == 0)
        kiln_company_each_light(in->company, begin_with_direct);
    if (in->settings->bounces == 0) /* there is no indirect light */
        memset(own->sum, 0, 3 * own->surface.count * sizeof *own->sum);
    if (in->settings->schedule == KILN_SCHEDULE_EQUAL && in->settings->bounces < 0 && part.count > first)
        kiln_tail_note_left(&in->solution->report, first);
    const bool decides = in->settings->schedule == KILN_SCHEDULE_LEAN && in->settings->bounces < 0 &&
                         last->step.role != KILN_CELLS_FINAL;
    const int status = decides ? kiln_tail_measure(in, &part, &last->tail_error, error) : KILN_OK;
    const size_t count = part.count - first;
    if (status != KILN_OK || !decides || last->step.role != KILN_CELLS_BOUNCE ||
        (!kiln_cells_settled(in->settings, part.of + first, count) && count <= KILN_BOUNCES_ALL))
        return status;
    return kiln_tile_error(in, &last->object_error, error);
}

/* Whether the device may keep the light of the step from bounce to bounce (worker/pass/held.h). This requires a given
 * number of bounces, and that each point gathers for itself with the same samples. */
static bool hold(struct kiln_integration *in, const struct kiln_step *step, struct kiln_held_step *how)
{
    const struct kiln_integrate_settings *s = in->settings;
    const bool final = step->role == KILN_CELLS_FINAL;
    const bool direct = step->pass == &kiln_pass_direct && step->role == KILN_CELLS_DIRECT && s->bounces > 0;
    if (s->schedule != KILN_SCHEDULE_LEAN || s->bounces < 0 || kiln_cells_adds_tail(s) || s->parts > 1 ||
        s->indirect_scale > 1 || s->final_scale > 1 || s->seen_only || s->caustics > KILN_CAUSTICS_NONE ||
        (step->pass != &kiln_pass_gather && !direct) || step->quantity != NULL || step->samples_field != NULL ||
        kiln_company_has_light(in->company))
        return false;
    *how = (struct kiln_held_step){.final = final,
                                   .compact = step->compact,
                                   .packs = final,
                                   .pack_stream = KILN_CELLS_FINAL_STREAM,
                                   .seed = (uint32_t)s->seed,
                                   .direct = direct};
    if (final)
        in->solution->report.bounces = step->bounce;
    return true;
}

const struct kiln_integrator kiln_integrator_cells = {.name = "cells",
                                                      .roles = roles,
                                                      .role_count = sizeof roles / sizeof *roles,
                                                      .next = kiln_cells_next,
                                                      .begin_step = begin_step,
                                                      .take = kiln_cells_take,
                                                      .end_step = end_step,
                                                      .hold = hold};
