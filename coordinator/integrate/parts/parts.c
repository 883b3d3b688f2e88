#include "coordinator/integrate/parts/parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/rounds.h"
#include "coordinator/integrate/parts/worst.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/packing.h"
#include "worker/pass/caustic.h"
#include "worker/scene/radiosity.h"

enum { ROUNDING = 1 << 16 }; /* streams of rounding after those of steps */

/* ---- the sequence of steps, and each part's share of their samples ---- */

size_t kiln_part_first(const struct kiln_step_report *reports, size_t count)
{
    size_t first = count > 0 ? count - 1 : 0;
    while (first > 0 && reports[first - 1].step.part == reports[count - 1].step.part)
        first--;
    return first;
}

/* Gives a part its own light paths in a step whose samples are set; `first`: the samples in the first round. With
 * growing iterations, and with an error of published light, the iterations of all parts follow one another just as
 * samples do. The division is exact: samples are multiples of half of `first`, and KILN_ITERATIONS_FIRST is even; those
 * of caustics with a level of their own are multiples of `first`. */
static void share_iterations(const struct kiln_integrate_settings *settings, uint32_t first, struct kiln_step *step)
{
    const uint64_t iterations = step->iterations;
    step->first_iteration = (uint32_t)(iterations * step->part);
    if ((settings->iterations_grow || settings->published_error > 0.0) && kiln_step_has(step, KILN_WITH(landing))) {
        step->iterations = (uint32_t)(iterations * step->samples / first);
        step->first_iteration = (uint32_t)(iterations * step->first_sample / first);
    }
}

/* Gives a part its share of the step's samples, and its range in the sample sequence. `round`: round of the part; NULL:
 * the first round. */
static void share_samples(const struct kiln_integrate_settings *settings, const struct kiln_round *round, uint32_t part,
                          struct kiln_step *step)
{
    if (settings->parts <= 1)
        return;
    step->part = part;
    step->samples = kiln_has_rounds(settings) ? kiln_round_first(step->samples, step->counted)
                                              : (step->samples + KILN_PARTS - 1) / KILN_PARTS;
    step->first_sample = step->samples * (part % KILN_PARTS);
    const uint32_t first = step->samples;
    struct kiln_round own;
    if (round != NULL) {
        own = settings->goes_on && step->pass == &kiln_pass_caustic ? kiln_round_of_caustics(round) : *round;
        kiln_round_share(&own, part % KILN_PARTS, step->counted, step);
    }
    step->counted = step->counted && round == NULL;
    share_iterations(settings, first, step);
}

/* Whether another round follows the last report, which ends a round. */
static bool wants_round(const struct kiln_integrate_settings *settings, const struct kiln_step_report *last)
{
    return kiln_has_rounds(settings) && last->round.to > last->round.from;
}

/* The settings that a part's steps are of. `round`: as above. */
static struct kiln_integrate_settings settings_of(const struct kiln_integrate_settings *settings, uint32_t part,
                                                  const struct kiln_round *round)
{
    struct kiln_integrate_settings of_part = *settings;
    of_part.goes_on = settings->published_error > 0.0 && part >= KILN_PARTS;
    if (of_part.goes_on && round != NULL && round->caustics_to == round->caustics_from)
        of_part.caustics = KILN_CAUSTICS_NONE;
    return of_part;
}

bool kiln_parts_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step)
{
    const size_t first = kiln_part_first(reports, count);
    uint32_t part = count > 0 ? reports[first].step.part : 0;
    const struct kiln_round *round = count > 0 ? kiln_round_of(reports, count) : NULL;
    struct kiln_integrate_settings of_part = settings_of(settings, part, round);
    bool any = settings->integrator->next(&of_part, count > 0 ? &reports[first] : NULL, count - first, step);
    if (!any && settings->parts > 1 && ((part + 1) % KILN_PARTS != 0 || wants_round(settings, &reports[count - 1]))) {
        round = ++part % KILN_PARTS == 0 ? &reports[count - 1].round : round;
        of_part = settings_of(settings, part, round);
        any = settings->integrator->next(&of_part, NULL, 0, step);
    }
    if (any)
        share_samples(&of_part, round, part, step);
    return any;
}

/* ---- means ---- */

static struct kiln_part_weight weight_of(double before, uint32_t part)
{
    const double of_number = (before - (double)(part % KILN_PARTS)) / KILN_PARTS;
    return (struct kiln_part_weight){.before = before,
                                     .share = part < KILN_PARTS ? 1.0f : (float)(1.0 / (of_number + 1.0))};
}

/* Weight of all that a tile run has found with so many samples of a part. */
static double weight_of_samples(double samples) { return samples * samples; }

struct kiln_part_weight kiln_part_weight(const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run,
                                         const struct kiln_step *step)
{
    if (step->part < KILN_PARTS)
        return weight_of((double)step->part, step->part);
    if (data->samples_taken == NULL || step->samples_field == NULL)
        return weight_of((double)step->first_sample / (double)step->samples, step->part);
    const size_t i = (size_t)(tile_run - data->surface.tile_runs);
    const double before = weight_of_samples(data->samples_taken[i]),
                 now = weight_of_samples((double)data->samples_taken[i] + data->samples[i]) - before;
    return weight_of(now > 0.0 ? (KILN_PARTS * before + step->part % KILN_PARTS * now) / now : 0.0, step->part);
}

double kiln_part_mix_error(double before, double error, const struct kiln_part_weight *weight)
{
    const double parts = weight->before;
    return parts > 0.0 ? sqrt(parts * parts * before * before + error * error) / (parts + 1.0) : error;
}

/* Mean luminance at a point found by part k of each round, averaged over rounds with their samples as weights. */
static float *found_by(const struct kiln_rank_data *data, struct kiln_own_point own, uint32_t part)
{
    return &data->parts[KILN_PARTS * own.at + part % KILN_PARTS];
}

void kiln_part_begin(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance, uint32_t part,
                     const struct kiln_part_weight *weight)
{
    if (data->parts == NULL)
        return;
    float *found = found_by(data, own, part);
    *found = (1.0f - weight->share) * *found + weight->share * luminance;
}

void kiln_part_add(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance, uint32_t part,
                   const struct kiln_part_weight *weight)
{
    if (data->parts != NULL)
        *found_by(data, own, part) += weight->share * luminance;
}

/* Radiosity in all of a point, as part `part` of each round has found it. */
static uint64_t *sent_by(const struct kiln_rank_data *data, struct kiln_own_point own, uint32_t part)
{
    return &data->parts_radiosity[KILN_PARTS * own.at + part % KILN_PARTS];
}

void kiln_part_send(const struct kiln_rank_data *data, struct kiln_own_point own, const struct kiln_tile_run *run,
                    uint32_t bit, const float radiosity[3], const struct kiln_step *step,
                    const struct kiln_part_weight *weight, bool more)
{
    float sent[3] = {0.0f, 0.0f, 0.0f};
    const float share = weight->share, before = more ? 1.0f : 1.0f - share;
    if (before > 0.0f)
        kiln_radiosity_unpack(*sent_by(data, own, step->part), sent);
    for (int c = 0; c < 3; c++)
        sent[c] = before * sent[c] + share * radiosity[c];
    *sent_by(data, own, step->part) =
        kiln_radiosity_pack(sent, kiln_packing_hash(run, bit, ROUNDING + KILN_ROLES_MAX * step->part + step->role));
}

void kiln_part_pack(const struct kiln_rank_data *data, const struct kiln_step *step)
{
#pragma omp parallel for schedule(static)
    for (uint64_t i = 0; i < data->surface.count; i++)
        data->next[i] = *sent_by(data, (struct kiln_own_point){i}, step->part);
}

/* Averages the part's indirect light into the means. */
static void take_indirect(const struct kiln_rank_data *data, const struct kiln_step *step)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const struct kiln_part_weight weight = kiln_part_weight(data, run, step);
        struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
        for (uint32_t k = 0; k < run->count && kiln_part_changes(data, run, step->part); k++, own.at++) {
            const float *indirect = data->sum + 3 * own.at;
            kiln_part_add(data, own, kiln_luminance_in_float(indirect), step->part, &weight);
            kiln_part_mix(data->indirect + 3 * own.at, indirect, 3, &weight);
        }
    }
}

static void state_errors(const struct kiln_rank_data *data, const struct kiln_part_survey *survey)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const struct kiln_own_point first = kiln_own_of_global(&data->surface, run->first);
        float errors[KILN_PART_ERRORS];
        kiln_part_errors(data, run, survey, errors);
        for (uint32_t k = 0; k < run->count; k++)
            data->error[first.at + k] = kiln_error_pack(errors[k]);
    }
}

/* ---- the end of a part: one of several solves, each with a share of the samples (parts.h) ---- */

static bool is_over(const struct kiln_integrate_settings *settings, const struct kiln_step_reports *steps,
                    const struct kiln_step_reports *part)
{
    struct kiln_step step;
    const struct kiln_integrate_settings of_part =
        settings_of(settings, part->of[0].step.part, kiln_round_of(steps->of, steps->count));
    return !settings->integrator->next(&of_part, part->of, part->count, &step);
}

int kiln_part_end(const struct kiln_integrate_params *p, struct kiln_solution *solution, double unit,
                  struct kiln_error *error)
{
    const struct kiln_rank_data *data = solution->own;
    const struct kiln_step_reports *steps = &solution->report.steps, part = kiln_part_reports(steps);
    struct kiln_step_report *last = kiln_solution_step(solution);
    struct kiln_part_survey survey;
    struct kiln_step next;
    int status = KILN_OK;
    if (data->parts == NULL || !is_over(p->settings, steps, &part))
        return KILN_OK;
    take_indirect(data, &last->step);
    if (kiln_has_rounds(p->settings) && (last->step.part + 1) % KILN_PARTS == 0) {
        const double start = MPI_Wtime();
        status = kiln_round_judge(p, data, unit, &solution->report.steps, error);
        last->judging_seconds += MPI_Wtime() - start;
        if (status == KILN_OK && p->listener != NULL && p->rank == 0 && last->step.part == KILN_PARTS - 1 &&
            last->foretold.tried > 0)
            p->listener->first_round(p->listener->context, steps);
    }
    if (status != KILN_OK || kiln_parts_next(p->settings, steps->of, steps->count, &next))
        return status;
    memcpy(data->sum, data->indirect, 3 * data->surface.count * sizeof *data->sum);
    status = kiln_part_survey(p, data, &part, unit, &survey, error);
    if (status == KILN_OK)
        state_errors(data, &survey);
    kiln_part_survey_release(&survey);
    return status;
}

/* ---- parts as a companion of integration steps (coordinator/integrate/companion.h) ---- */

static bool parts_wanted(const struct kiln_integrate_params *params) { return params->settings->parts > 1; }

static int after_step(void *self, const struct kiln_companion_site *site, double unit, struct kiln_error *error)
{
    const struct kiln_step *step = &kiln_solution_step(site->solution)->step;
    (void)self;
    return step->quantity == NULL ? kiln_part_end(site->params, site->solution, unit, error) : KILN_OK;
}

/* Index behind the last step of light: quantities follow it. */
static size_t end_of_light(const struct kiln_step_reports *steps)
{
    size_t end = steps->count;
    while (end > 0 && steps->of[end - 1].step.quantity != NULL)
        end--;
    return end;
}

/* Finds the object with the largest error. It is looked for after the last step rather than with the last judgement, so
 * that a bake that goes on from a checkpoint of all light knows it, too; what texels lose it does not know. */
static int find_worst(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kiln_integrate_report *r = &site->solution->report;
    const size_t last = end_of_light(&r->steps);
    (void)self;
    if (!(site->params->settings->published_error > 0.0) || last == 0)
        return KILN_OK;
    r->texel_loss = r->steps.of[last - 1].texel_loss;
    return kiln_worst_find(site->params, site->solution->own, r->steps.of[last - 1].unfinished, &r->worst, error);
}

static bool is_sane(const struct kiln_step_report *report) { return kiln_round_is_sane(&report->round); }

/* The levels of the rounds after the first, of the first `count` steps: what --rounds takes. */
static json_t *levels_of(const struct kiln_step_reports *steps, size_t count)
{
    json_t *levels = json_array();
    for (size_t i = 0; i + 1 < count; i++)
        if (steps->of[i].round.to > steps->of[i].round.from)
            (void)json_array_append_new(levels, json_integer((json_int_t)steps->of[i].round.to));
    return levels;
}

/* The option that, in the place of --time, repeats a bake without a clock. */
static json_t *repeat_of(const json_t *levels)
{
    char text[256];
    int at = snprintf(text, sizeof text, "--rounds %s", json_array_size(levels) > 0 ? "" : "0");
    for (size_t i = 0; i < json_array_size(levels); i++)
        at += snprintf(text + at, sizeof text - (size_t)at, "%s%lld", i > 0 ? "," : "",
                       (long long)json_integer_value(json_array_get(levels, i)));
    return json_string(text);
}

/* Adds the outcome of rounds to the report: what --target-error or --quality asked for, what was reached, and the
 * number of rounds. */
static void report(const struct kiln_companion_told *told, json_t *json)
{
    const struct kiln_step_reports *steps = &told->solution->report.steps;
    const double target = told->job->light.target_error, published = told->job->light.published_error;
    const size_t last = end_of_light(steps);
    const struct kiln_worst_object *worst = &told->solution->report.worst;
    if (!kiln_job_has_rounds(told->job) || kiln_job_parts(told->job) == 1 || last == 0)
        return;
    if (published > 0.0) {
        (void)json_object_set_new(json, "asked", json_real(published));
        (void)json_object_set_new(json, "published", json_real(steps->of[last - 1].unfinished));
        (void)json_object_set_new(json, "out_of_time", json_boolean(steps->of[last - 1].out_of_time));
        (void)json_object_set_new(
            json, "most_samples",
            json_boolean(steps->of[last - 1].unfinished > published && steps->of[last - 1].foretold.limited));
        (void)json_object_set_new(json, "levels", levels_of(steps, last));
        if (told->job->light.time > 0.0) {
            (void)json_object_set_new(json, "time", json_real(told->job->light.time));
            (void)json_object_set_new(json, "repeat", repeat_of(json_object_get(json, "levels")));
        }
        if (told->solution->report.texel_loss > 0.0)
            (void)json_object_set_new(json, "texels_lose", json_real(told->solution->report.texel_loss));
        if (worst->known)
            (void)json_object_set_new(
                json, "worst",
                json_pack("{s:s, s:f}", "object",
                          kiln_scene_string(told->scene, told->scene->objects[worst->object].original_name),
                          "published", worst->published));
    } else {
        (void)json_object_set_new(json, "target", json_real(target));
        (void)json_object_set_new(json, "above_target", json_real(steps->of[last - 1].unfinished));
    }
    (void)json_object_set_new(json, "rounds",
                              json_integer((json_int_t)(steps->of[last - 1].step.part / KILN_PARTS + 1)));
}

/* A preset's counts are options by themselves. */
static void identify(const struct kiln_job *job, json_t *fields)
{
    if (job->light.published_error > 0.0)
        (void)json_object_set_new(fields, "error of published light", json_real(job->light.published_error));
    if (job->light.rounds != NULL)
        (void)json_object_set_new(fields, "rounds", json_string(job->light.rounds));
}

static double beside(const struct kiln_step_report *report) { return report->judging_seconds; }

static const char *const identity[] = {"error-map", "target-error", NULL};

const struct kiln_companion kiln_companion_parts = {.name = "parts",
                                                    .identity = identity,
                                                    .identify = identify,
                                                    .identity_after = "exchange",
                                                    .wanted = parts_wanted,
                                                    .after_step = after_step,
                                                    .end = find_worst,
                                                    .is_sane = is_sane,
                                                    .phase = "judging",
                                                    .beside = beside,
                                                    .report = {[KILN_REPORT_ERROR] = report}};
