#include "coordinator/integrate/radiosity/radiosity.h"

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/cells/cells.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/cells/take.h"
#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/radiosity/unshot.h"
#include "worker/pass/directions.h"
#include "worker/pass/links.h"
#include "worker/pass/patches.h"
#include "worker/scene/radiosity.h"

/* Roles in the order of KILN_CELLS_DIRECT, ...; light from emitters takes the place of caustics; the third and fourth
 * are not used; KILN_RADIOSITY_ROUND follows. */
static const struct kiln_role roles[] = {
    {.kind = "direct", .total = "direct", .title = "direct light", .phase = "direct light"},
    {.kind = "bounce", .total = "bounces", .title = "bounce", .phase = "bounces", .numbered = true},
    {.kind = "final", .total = "final", .title = "final gather", .phase = "bounces"},
    {.kind = "pilot", .total = "pilot", .title = "direct light, pilot", .phase = "direct light"},
    {.kind = "emitters", .total = "emitters", .title = "emitters", .phase = "emitters", .optional = true},
    {.kind = "round",
     .total = "rounds",
     .title = "round of bounce",
     .phase = "bounces",
     .numbered = true,
     .optional = true}};

/* Returns the settings for the functions of "cells". The step of light from emitters is treated like that of
 * caustics. */
static struct kiln_integrate_settings settings_of_cells(const struct kiln_integrate_settings *settings)
{
    struct kiln_integrate_settings of_cells = *settings;
    of_cells.caustics = settings->patches->lights == KILN_LIGHTS_PATCHES ? KILN_CAUSTICS_GATHER : KILN_CAUSTICS_NONE;
    return of_cells;
}

/* Number of steps before the rounds: direct light, and the one step that uses all patches, light from emitters or the
 * first bounce. */
static size_t steps_before_rounds(const struct kiln_integrate_settings *settings)
{
    const struct kiln_integrate_settings of_cells = settings_of_cells(settings);
    return kiln_cells_first(&of_cells) + (settings->patches->lights == KILN_LIGHTS_PATCHES ? 1 : 2);
}

/* Number of a point's rays that complete its row of links, at most `samples`. */
static uint32_t links_samples(const struct kiln_integrate_settings *settings, uint32_t samples)
{
    const double error = settings->patches->link_error, target = settings->target_error;
    return kiln_links_samples(target > 0.0 && target < error ? target : error, samples);
}

/* The parameters of a step of patches are its nodes, or where its rays go: coordinator/integrate/patches/patches.h. */
static bool next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports, size_t count,
                 struct kiln_step *step)
{
    const struct kiln_integrate_settings of_cells = settings_of_cells(settings);
    const size_t before = steps_before_rounds(settings);
    if (settings->patches->order == KILN_ORDER_UNSHOT && settings->bounces != 0 && count >= before)
        return kiln_unshot_next(settings, reports, count, before, step);
    const bool any = kiln_cells_next(&of_cells, reports, count, step);
    if (step->role == KILN_CELLS_CAUSTIC)
        step->stream = KILN_CELLS_FINAL_STREAM;
    if (step->role != KILN_CELLS_DIRECT) {
        const struct kiln_patch_settings *p = settings->patches;
        step->pass = p->gather != KILN_GATHER_PAIRS     ? &kiln_pass_directions
                     : p->patches == KILN_PATCHES_LINKS ? &kiln_pass_links
                                                        : &kiln_pass_patches;
        step->samples = p->directions > 0                  ? p->directions
                        : p->patches == KILN_PATCHES_LINKS ? links_samples(settings, step->samples)
                                                           : step->samples;
    }
    return any;
}

static int begin_step(struct kiln_integration *in, struct kiln_step_report *last, const struct kiln_step *step,
                      struct kiln_error *error)
{
    return kiln_step_has(step, KILN_WITH(senders)) ? kiln_unshot_begin(in, last, step)
                                                   : kiln_integrator_cells.begin_step(in, last, step, error);
}

/* Adds emitters' light as direct light. */
static void enter_emitted(const struct kiln_rank_data *data, struct kiln_own_point own, const struct kiln_point_mean *r,
                          const float radiosity[3])
{
    for (uint64_t c = 0; c < 3; c++) {
        data->direct[3 * own.at + c] += r->irradiance[c];
        data->sum[3 * own.at + c] += radiosity[c];
        if (data->radiosity != NULL)
            data->radiosity[3 * own.at + c] += radiosity[c];
    }
}

static void take_emitted(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *f,
                         const struct kiln_point_result *results, struct kiln_tally *sums,
                         struct kiln_tile_run_tally *tile_run)
{
    const bool counts =
        (t->scene->objects[kiln_map_object(&data->surface, f->map)].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
    struct kiln_own_point own = kiln_own_of_global(&data->surface, f->first);
    for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own.at++, results++) {
        const struct kiln_point_mean mean = kiln_point_mean(results);
        float albedo[3], radiosity[3];
        kiln_point_albedo(&data->surface, own, albedo);
        for (int c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * mean.incident[c];
        if (counts)
            kiln_cells_tally(t, &data->surface, own, &mean, albedo, NULL, sums, tile_run);
        enter_emitted(data, own, &mean, radiosity);
        data->next[own.at] = kiln_radiosity_pack(
            &data->sum[3 * own.at], kiln_packing_hash(f, (uint32_t)__builtin_ctzll(rest), t->step->stream));
    }
}

/* Returns the answers of the tile run's points. Those of the patches pass are copied to `points`, and the way in which
 * rows were completed is kept. */
static const struct kiln_point_result *point_results(const struct kiln_taking *t, const struct kiln_rank_data *data,
                                                     const struct kiln_tile_run *f, const void *answers,
                                                     struct kiln_point_result points[KILN_TILE_TEXELS])
{
    const struct kiln_patches_result *results = answers;
    const uint64_t first = kiln_own_of_global(&data->surface, f->first).at;
    if (t->step->pass != &kiln_pass_patches)
        return answers;
    for (uint64_t k = 0; k < f->count; k++) {
        points[k] = results[k].point;
        if (data->surface.closing != NULL && !kiln_step_has(t->step, KILN_WITH(senders)))
            kiln_closing_keep(&results[k], data->surface.closing + KILN_CLOSING_FLOATS * (first + k));
    }
    return points;
}

static void take(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *f,
                 const void *answers, struct kiln_tally *sums, struct kiln_tile_run_tally *tile_run)
{
    struct kiln_point_result points[KILN_TILE_TEXELS];
    const struct kiln_point_result *results = point_results(t, data, f, answers, points);
    if (kiln_step_has(t->step, KILN_WITH(senders)))
        kiln_unshot_take(t, data, f, results, sums, tile_run);
    else if (t->step->role == KILN_CELLS_CAUSTIC)
        take_emitted(t, data, f, results, sums, tile_run);
    else
        kiln_cells_take(t, data, f, results, sums, tile_run);
}

static int end_step(struct kiln_integration *in, struct kiln_step_reports *reports, struct kiln_error *error)
{
    const struct kiln_integrate_settings of_cells = settings_of_cells(in->settings);
    struct kiln_integration as_cells = *in;
    as_cells.settings = &of_cells;
    const int status = kiln_integrator_cells.end_step(&as_cells, reports, error);
    if (kiln_step_has(&reports->of[reports->count - 1].step, KILN_WITH(senders)) && in->settings->bounces < 0)
        in->solution->report.tail_error = kiln_unshot_share(reports->of, reports->count);
    return status;
}

const struct kiln_integrator kiln_integrator_radiosity = {.name = "radiosity",
                                                          .roles = roles,
                                                          .role_count = sizeof roles / sizeof *roles,
                                                          .next = next,
                                                          .begin_step = begin_step,
                                                          .take = take,
                                                          .end_step = end_step};
