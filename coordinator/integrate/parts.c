#include "coordinator/integrate/parts.h"

#include <math.h>
#include <string.h>

#include "coordinator/field/packed_error.h"
#include "coordinator/integrate/integrator.h"

enum { REACH = 2, SIDE = 8 }; /* texels: how far variances are averaged; of a tile */

/* ---- which steps ---- */

size_t kiln_part_first(const struct kiln_step_report *reports, size_t count)
{
    size_t first = count > 0 ? count - 1 : 0;
    while (first > 0 && reports[first - 1].step.part == reports[count - 1].step.part)
        first--;
    return first;
}

/* Of a step's samples, those of the part. */
static void share_samples(const struct kiln_integrate_settings *settings, uint32_t part, struct kiln_step *step)
{
    const uint64_t parts = settings->parts > 0 ? settings->parts : 1,
                   all = step->samples > parts ? step->samples : parts;
    const uint64_t first = all * part / parts, end = all * (part + 1) / parts;
    step->part = part;
    step->first_sample = (uint32_t)first;
    step->samples = (uint32_t)(end - first);
}

bool kiln_parts_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step)
{
    const size_t first = kiln_part_first(reports, count);
    uint32_t part = count > 0 ? reports[first].step.part : 0;
    bool any = settings->integrator->next(settings, reports + first, count - first, step);
    if (!any && part + 1 < settings->parts)
        any = settings->integrator->next(settings, reports + count, 0, step), part++;
    if (any)
        share_samples(settings, part, step);
    return any;
}

/* ---- means ---- */

double kiln_part_mix_error(double before, double error, uint32_t part)
{
    const double parts = (double)part + 1.0;
    return part == 0 ? error : sqrt((parts - 1.0) * (parts - 1.0) * before * before + error * error) / parts;
}

void kiln_part_add(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance, uint32_t part)
{
    if (data->parts != NULL)
        data->parts[KILN_PARTS * own.at + part] += luminance;
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

static void state_errors(const struct kiln_rank_data *data)
{
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
        float tile[SIDE * SIDE];
        lay_out(data, run, tile);
        for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++)
            data->error[own.at] = kiln_error_pack(sqrtf(pooled(tile, __builtin_ctzll(rest))));
    }
}

void kiln_part_end(const struct kiln_rank_data *own_data, uint32_t part, bool is_last)
{
    if (own_data->parts == NULL)
        return;
    for (uint64_t i = 0; i < own_data->surface.count; i++) {
        const float *found = own_data->sum + 3 * i;
        kiln_part_add(own_data, (struct kiln_own_point){i}, kiln_luminance_in_float(found), part);
        kiln_part_mix(own_data->indirect + 3 * i, found, 3, part);
    }
    if (!is_last)
        return;
    memcpy(own_data->sum, own_data->indirect, 3 * own_data->surface.count * sizeof *own_data->sum);
    state_errors(own_data);
}
