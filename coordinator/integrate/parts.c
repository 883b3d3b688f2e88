#include "coordinator/integrate/parts.h"

#include <math.h>
#include <string.h>

enum {
    REACH = 2,             /* texels: how far variances are averaged */
    SIDE = 8,              /* of a tile, texels */
    SAMPLES_MOST = 1 << 18 /* of a step of one part; steps that would have more do not come */
};
#define ENOUGH 0.05     /* share of the points that may miss the target error */
#define SAFETY 1.25     /* of what a round is expected to take */
#define LEAST_LIGHT 0.1 /* of the mean luminance: darker points need no smaller errors than points as bright */

/* ---- which steps ---- */

size_t kiln_part_first(const struct kiln_step_report *reports, size_t count)
{
    size_t first = count > 0 ? count - 1 : 0;
    while (first > 0 && reports[first - 1].step.part == reports[count - 1].step.part)
        first--;
    return first;
}

/* The share of a step's samples that the part has, and which ones of the sequence. */
static void share_samples(const struct kiln_integrate_settings *settings, uint32_t part, struct kiln_step *step)
{
    const uint32_t round = part / KILN_PARTS, own = part % KILN_PARTS;
    if (settings->parts <= 1)
        return;
    const uint64_t first_round = (step->samples + KILN_PARTS - 1) / KILN_PARTS, before = round > 0 ? KILN_PARTS : 0;
    const uint64_t samples = round > 0 ? first_round << (round - 1) : first_round;
    step->part = part;
    step->samples = (uint32_t)samples;
    step->first_sample = (uint32_t)(samples * (before + own));
    step->counted = step->counted && round == 0;
    if (step->terminal && round > 0)
        step->samples_field = KILN_FIELD_SAMPLES;
}

/* Whether another round comes after the last of the reports, which ends one. */
static bool wants_round(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                        size_t count)
{
    const struct kiln_step_report *last = &reports[count - 1];
    uint32_t most = 0;
    for (size_t i = kiln_part_first(reports, count); i < count; i++)
        most = reports[i].step.samples > most ? reports[i].step.samples : most;
    return settings->target_error > 0.0 && last->unfinished > ENOUGH && !last->out_of_time && most <= SAMPLES_MOST / 2;
}

bool kiln_parts_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step)
{
    const size_t first = kiln_part_first(reports, count);
    uint32_t part = count > 0 ? reports[first].step.part : 0;
    bool any = settings->integrator->next(settings, reports + first, count - first, step);
    if (!any && settings->parts > 1 && ((part + 1) % KILN_PARTS != 0 || wants_round(settings, reports, count))) {
        any = settings->integrator->next(settings, reports + count, 0, step);
        part++;
    }
    if (any)
        share_samples(settings, part, step);
    return any;
}

/* ---- means ---- */

double kiln_part_mix_error(double before, double error, uint32_t part)
{
    const double parts = (double)kiln_part_before(part);
    return part == 0 ? error : sqrt(parts * parts * before * before + error * error) / (parts + 1.0);
}

/* What part k of each round has found at a point is averaged over the rounds, by their samples. */
static float *found_by(const struct kiln_rank_data *data, struct kiln_own_point own, uint32_t part)
{
    return &data->parts[KILN_PARTS * own.at + part % KILN_PARTS];
}

static float share_of(uint32_t part) { return part < KILN_PARTS ? 1.0f : 0.5f; }

void kiln_part_begin(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance, uint32_t part)
{
    if (data->parts == NULL)
        return;
    float *found = found_by(data, own, part);
    *found = (1.0f - share_of(part)) * *found + share_of(part) * luminance;
}

/* Takes what the part has found of indirect light into the means. */
static void take_indirect(const struct kiln_rank_data *data, uint32_t part)
{
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
        for (uint32_t k = 0; k < run->count && kiln_part_changes(data, run, part); k++, own.at++) {
            const float *indirect = data->sum + 3 * own.at;
            *found_by(data, own, part) += share_of(part) * kiln_luminance_in_float(indirect);
            kiln_part_mix(data->indirect + 3 * own.at, indirect, 3, part);
        }
    }
}

/* ---- errors ---- */

/* Square of the standard error of the mean over the parts at a point. */
static float variance_of(const float parts[KILN_PARTS])
{
    float mean = 0.0f, square = 0.0f;
    for (int k = 0; k < KILN_PARTS; k++)
        mean += parts[k] / (float)KILN_PARTS;
    for (int k = 0; k < KILN_PARTS; k++)
        square += (parts[k] - mean) * (parts[k] - mean);
    return square / (float)(KILN_PARTS * (KILN_PARTS - 1));
}

/* The variances of a tile run's points at their places in the tile; -1 where there is none. */
static void lay_out(const struct kiln_rank_data *data, const struct kiln_tile_run *run, float tile[SIDE * SIDE])
{
    struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
    for (int i = 0; i < SIDE * SIDE; i++)
        tile[i] = -1.0f;
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++)
        if (kiln_point_valid(&data->surface, own))
            tile[__builtin_ctzll(rest)] = variance_of(data->parts + KILN_PARTS * own.at);
}

static float pooled(const float tile[SIDE * SIDE], int place)
{
    const int x = place % SIDE, y = place / SIDE;
    float sum = 0.0f, count = 0.0f;
    for (int v = y > REACH ? y - REACH : 0; v <= y + REACH && v < SIDE; v++)
        for (int u = x > REACH ? x - REACH : 0; u <= x + REACH && u < SIDE; u++)
            if (tile[v * SIDE + u] >= 0.0f) {
                sum += tile[v * SIDE + u];
                count += 1.0f;
            }
    return count > 0.0f ? sum / count : 0.0f;
}

/* The standard errors of a tile run's points, one after the other. */
static void find_errors(const struct kiln_rank_data *data, const struct kiln_tile_run *run, float errors[SIDE * SIDE])
{
    float tile[SIDE * SIDE];
    lay_out(data, run, tile);
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1)
        *errors++ = sqrtf(pooled(tile, __builtin_ctzll(rest)));
}

static void state_errors(const struct kiln_rank_data *data)
{
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const struct kiln_own_point first = kiln_own_of_global(&data->surface, run->first);
        float errors[SIDE * SIDE];
        find_errors(data, run, errors);
        for (uint32_t k = 0; k < run->count; k++)
            data->error[first.at + k] = kiln_error_pack(errors[k]);
    }
}

/* ---- the target ---- */

static double luminance_at(const struct kiln_rank_data *data, uint64_t own)
{
    return kiln_luminance_of_floats(data->direct + 3 * own) + kiln_luminance_of_floats(data->indirect + 3 * own);
}

/* Collective. Mean luminance of the irradiance of all points, by area. */
static int find_mean(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, double unit,
                     double *mean, struct kiln_error *error)
{
    struct kiln_exact_sum power = {0};
    for (uint64_t i = 0; i < data->surface.count; i++)
        if (kiln_point_valid(&data->surface, (struct kiln_own_point){i}))
            kiln_exact_add(&power, (double)data->surface.area[i] * luminance_at(data, i), 1.0 / unit);
    const int status = kiln_exact_reduce(p->communicator, &power, 1, error);
    *mean = p->area > 0.0 ? kiln_exact_value(&power, unit) / p->area : 0.0;
    return status;
}

/* How many points of a tile run miss the target. */
static uint64_t count_missing(const struct kiln_rank_data *data, const struct kiln_tile_run *run, double target,
                              double least)
{
    const struct kiln_own_point first = kiln_own_of_global(&data->surface, run->first);
    uint64_t missing = 0;
    float errors[SIDE * SIDE];
    find_errors(data, run, errors);
    for (uint32_t k = 0; k < run->count; k++)
        missing += (double)errors[k] > target * fmax(luminance_at(data, first.at + k), least);
    return missing;
}

/* Collective. After a round: which tile runs are finished, and what share of all points is not as good as wanted. */
static int judge(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, double unit,
                 struct kiln_step_report *last, struct kiln_error *error)
{
    double mean = 0.0;
    uint64_t missing = 0;
    const uint32_t round = last->step.part / KILN_PARTS + 1;
    const int status = find_mean(p, data, unit, &mean, error);
    for (size_t i = 0; status == KILN_OK && i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const uint64_t here = count_missing(data, run, p->settings->target_error, LEAST_LIGHT * mean);
        const bool finished =
            (double)here <= ENOUGH * (double)run->count || !kiln_part_changes(data, run, last->step.part);
        missing += here;
        const uint32_t samples = (p->settings->samples_indirect + KILN_PARTS - 1) / KILN_PARTS;
        data->samples[i] = finished ? 0 : samples << (round - 1);
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, &missing, 1, MPI_UINT64_T, MPI_SUM, p->communicator);
    last->unfinished = p->surface->point_count > 0 ? (double)missing / (double)p->surface->point_count : 0.0;
    return status;
}

/* Collective. Whether the next round, twice as long as the one before, would hardly end within --max-time. */
static bool is_out_of_time(const struct kiln_integrate_params *p, const struct kiln_step_reports *steps)
{
    const uint32_t round = steps->of[steps->count - 1].step.part / KILN_PARTS;
    const double left = kiln_control_seconds_left(p->control);
    double seconds = 0.0;
    for (size_t i = 0; i < steps->count; i++)
        if (steps->of[i].step.part / KILN_PARTS == round)
            seconds += steps->of[i].seconds + steps->of[i].exchange_seconds;
    int over = isfinite(left) && left < SAFETY * 2.0 * seconds;
    (void)MPI_Bcast(&over, 1, MPI_INT, 0, p->communicator);
    return over != 0;
}

/* ---- a part is over ---- */

static bool is_over(const struct kiln_integrate_settings *settings, const struct kiln_step_reports *part)
{
    struct kiln_step step;
    return !settings->integrator->next(settings, part->of, part->count, &step);
}

int kiln_part_end(const struct kiln_integrate_params *p, struct kiln_solution *solution, double unit,
                  struct kiln_error *error)
{
    const struct kiln_rank_data *data = solution->own;
    const struct kiln_step_reports *steps = &solution->report.steps, part = kiln_part_reports(steps);
    struct kiln_step_report *last = kiln_solution_step(solution);
    struct kiln_step next;
    int status = KILN_OK;
    if (data->parts == NULL || !is_over(p->settings, &part))
        return KILN_OK;
    take_indirect(data, last->step.part);
    if (p->settings->target_error > 0.0 && (last->step.part + 1) % KILN_PARTS == 0)
        status = judge(p, data, unit, last, error);
    if (p->settings->target_error > 0.0 && (last->step.part + 1) % KILN_PARTS == 0)
        last->out_of_time = is_out_of_time(p, steps);
    if (status != KILN_OK || kiln_parts_next(p->settings, steps->of, steps->count, &next))
        return status;
    memcpy(data->sum, data->indirect, 3 * data->surface.count * sizeof *data->sum);
    state_errors(data);
    return KILN_OK;
}
