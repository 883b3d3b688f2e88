#include "coordinator/integrate/reference/reference.h"

#include "coordinator/integrate/companion.h"
#include "coordinator/field/rank_data.h"
#include "coordinator/integrate/cells/adapt.h"
#include "coordinator/integrate/cells/cells.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/cells/take.h"
#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/parts/parts.h"
#include "worker/pass/reference.h"

/* In the order of KILN_CELLS_DIRECT, ...; the paths are the final gather. There are no bounces. */
static const struct kiln_role roles[] = {
    {.kind = "direct", .total = "direct", .title = "direct light", .phase = "direct light"},
    {.kind = "bounce", .total = "bounces", .title = "bounce", .phase = "bounces", .optional = true},
    {.kind = "paths", .total = "paths", .title = "paths", .phase = "paths"},
    {.kind = "pilot", .total = "pilot", .title = "direct light, pilot", .phase = "direct light"}};

/* Chooses the next step: direct light as in "cells", then the paths. Radiosity has no compact form, since none is
 * exchanged. */
static bool next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports, size_t count,
                 struct kiln_step *step)
{
    const size_t first = kiln_cells_first(settings);
    if (count > first + 1)
        return false;
    if (count <= first) {
        (void)kiln_cells_next(settings, reports, count, step);
        step->compact = step->early = false;
        return true;
    }
    *step = (struct kiln_step){.pass = &kiln_pass_reference,
                               .parameters = settings->reference,
                               .role = KILN_CELLS_FINAL,
                               .bounce = 1,
                               .samples = settings->samples_indirect,
                               .stream = KILN_CELLS_FINAL_STREAM,
                               .with = settings->seen_only ? KILN_WITH(seen) : 0,
                               .counted = true,
                               .terminal = true};
    return true;
}

static int begin_step(struct kiln_integration *in, struct kiln_step_report *last, const struct kiln_step *step,
                      struct kiln_error *error)
{
    (void)last, (void)error;
    if (step->role == KILN_CELLS_DIRECT)
        kiln_ledger_forget_groups(in->ledger);
    in->solution->report.bounces = in->settings->bounces > 0 ? (uint32_t)in->settings->bounces : 0;
    return KILN_OK;
}

/* Computes a point's outgoing light: direct light from the sum, plus the paths' answer, less light that has had all
 * allowed bounces. The answer's shares of lost light are shares of this. */
static void find_sent(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                      const struct kiln_reference_result *r, const float radiosity[3], const float albedo[3],
                      float sent[3])
{
    for (uint64_t c = 0; c < 3; c++)
        sent[c] = t->settings->bounces == 0
                      ? 0.0f
                      : data->sum[3 * own.at + c] + radiosity[c] - albedo[c] * kiln_mean(r->last[c], r->point.count);
}

static void take_paths(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                       const struct kiln_tile_run *f, const struct kiln_reference_result *results,
                       struct kiln_tally *sums, struct kiln_tile_run_tally *tile_run)
{
    const struct kiln_taking weighed = kiln_part_weigh(taking, data, f), *t = &weighed;
    const bool changes = kiln_part_changes(data, f, t->step->part);
    const bool counts =
        (t->scene->objects[kiln_map_object(&data->surface, f->map)].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
    struct kiln_own_point own = kiln_own_of_global(&data->surface, f->first);
    for (uint64_t i = 0; i < f->count; i++, own.at++) {
        const struct kiln_point_mean mean = kiln_point_mean(&results[i].point);
        float albedo[3], radiosity[3], sent[3];
        kiln_point_albedo(&data->surface, own, albedo);
        for (int c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * mean.incident[c];
        find_sent(t, data, own, &results[i], radiosity, albedo, sent);
        if (counts)
            kiln_cells_tally(t, &data->surface, own, &mean, albedo, sent, sums, tile_run);
        kiln_cells_enter(t, data, own, &mean, radiosity, changes);
    }
}

static void take(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *f,
                 const void *results, struct kiln_tally *sums, struct kiln_tile_run_tally *tile_run)
{
    if (t->step->pass != &kiln_pass_reference ||
        (kiln_step_has(t->step, KILN_WITH(seen)) && data->seen[f - data->surface.tile_runs] == 0))
        kiln_cells_take(t, data, f, results, sums, tile_run);
    else
        take_paths(t, data, f, results, sums, tile_run);
}

static int end_step(struct kiln_integration *in, struct kiln_step_reports *reports, struct kiln_error *error)
{
    const struct kiln_step *step = &reports->of[reports->count - 1].step;
    return step->role == KILN_CELLS_PILOT ? kiln_adapt_samples(in, in->settings->samples_direct - step->samples, error)
                                          : KILN_OK;
}

/* Paths from surface points find of caustics what gather rays do; and all where they are merged with paths of light. */
static void close_energy(const struct kiln_integrate_settings *settings, struct kiln_energy_closing *closing)
{
    closing->caustics = settings->reference->method == KILN_REFERENCE_VCM ? KILN_CAUSTICS_LAND : KILN_CAUSTICS_GATHER;
}

#define INTEGRATOR(method)                                                                                             \
    const struct kiln_integrator kiln_integrator_##method = {.name = #method,                                          \
                                                             .roles = roles,                                           \
                                                             .role_count = sizeof roles / sizeof *roles,               \
                                                             .next = next,                                             \
                                                             .begin_step = begin_step,                                 \
                                                             .take = take,                                             \
                                                             .end_step = end_step,                                     \
                                                             .close = close_energy};
INTEGRATOR(path)
INTEGRATOR(bdpt)
INTEGRATOR(vcm)
