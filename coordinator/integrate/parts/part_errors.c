#include "coordinator/integrate/parts/part_errors.h"

#include <math.h>

#include "coordinator/field/packed_error.h"
#include "coordinator/job/job.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum {
    REACH = 2, /* radius of the window over which variances are averaged, texels */
    SIDE = 8   /* of a tile, texels */
};

#define UNIT 0x1p-60           /* of exact sums of relative variances */
#define GAIN_LEAST (3.0 / 7.0) /* 3 / (4^p - 1) for p = 1.5 */

/* Squared standard error of the mean over the parts at a point. */
static float variance_of(const float parts[KILN_PARTS])
{
    float mean = 0.0f, square = 0.0f;
    for (int k = 0; k < KILN_PARTS; k++)
        mean += parts[k] / (float)KILN_PARTS;
    for (int k = 0; k < KILN_PARTS; k++)
        square += (parts[k] - mean) * (parts[k] - mean);
    return square / (float)(KILN_PARTS * (KILN_PARTS - 1));
}

/* The variances of a tile run's points, to their places in the tile. */
static void lay_out(const struct kiln_rank_data *data, const struct kiln_tile_run *run, float tile[SIDE * SIDE])
{
    struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++)
        if (kiln_point_valid(&data->surface, own))
            tile[kiln_part_place((uint32_t)__builtin_ctzll(rest))] = variance_of(data->parts + KILN_PARTS * own.at);
}

static void clear(float *variances, size_t count)
{
    for (size_t i = 0; i < count; i++)
        variances[i] = -1.0f;
}

/* Returns the variances of a tile with several tile runs; NULL: it has one run, or variances are not shared. */
static float *shared_of(const struct kiln_part_survey *survey, const struct kiln_surface *s,
                        const struct kiln_tile_run *run)
{
    const struct kiln_tile *tile = &s->tiles[s->lightmaps[run->map].tile_first + run->tile];
    if ((tile->first & KILN_TILE_SPLIT) == 0 || survey->shared == NULL)
        return NULL;
    return survey->shared + (size_t)KILN_PART_ERRORS * survey->shared_of[tile->first & ~KILN_TILE_SPLIT];
}

/* Collective. The variances of all points of tiles that have several tile runs. */
static int share(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                 struct kiln_part_survey *survey, struct kiln_error *error)
{
    const struct kiln_surface *s = &data->surface;
    const uint64_t limit = p->settings->exchange_limit, most = limit > 0 && limit < 1u << 30 ? limit : 1u << 30;
    uint32_t tiles = 0;
    int status = kiln_allocate(&survey->shared_of, (size_t)s->split_count, sizeof *survey->shared_of,
                               "the errors of tiles", error);
    for (uint64_t t = 0; t < s->tile_count && status == KILN_OK; t++)
        if ((s->tiles[t].first & KILN_TILE_SPLIT) != 0 && s->tiles[t].mask != 0)
            survey->shared_of[s->tiles[t].first & ~KILN_TILE_SPLIT] = tiles++;
    const size_t count = (size_t)KILN_PART_ERRORS * tiles;
    if (status == KILN_OK)
        status = kiln_allocate(&survey->shared, count, sizeof *survey->shared, "the errors of tiles", error);
    status = kiln_agree(p->communicator, status, error);
    if (status != KILN_OK)
        return status;
    clear(survey->shared, count);
    for (size_t i = 0; i < s->tile_run_count; i++) {
        float *tile = shared_of(survey, s, &s->tile_runs[i]);
        if (tile != NULL)
            lay_out(data, &s->tile_runs[i], tile);
    }
    for (size_t at = 0; at < count; at += most)
        (void)MPI_Allreduce(MPI_IN_PLACE, survey->shared + at, (int)(count - at < most ? count - at : most), MPI_FLOAT,
                            MPI_MAX, p->communicator);
    return KILN_OK;
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

/* Whether direct light and the last step, which carry most of the result, have a sample in each quarter. */
static bool has_quarters(const struct kiln_step_reports *part)
{
    return part->of[0].step.samples >= 4 && part->of[part->count - 1].step.samples >= 4;
}

double kiln_part_light(const struct kiln_rank_data *data, uint64_t own)
{
    const double light =
        kiln_luminance_of_floats(data->direct + 3 * own) + kiln_luminance_of_floats(data->indirect + 3 * own);
    return data->caustic != NULL ? light + kiln_luminance_of_floats(data->caustic + 3 * own) : light;
}

/* Collective. Mean luminance of the irradiance of all points, by area. */
static int find_mean(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, double unit,
                     double *mean, struct kiln_error *error)
{
    struct kiln_exact_sum power = {0};
    for (uint64_t i = 0; i < data->surface.count; i++)
        if (kiln_point_valid(&data->surface, (struct kiln_own_point){i}))
            kiln_exact_add(&power, (double)data->surface.area[i] * kiln_part_light(data, i), 1.0 / unit);
    const int status = kiln_exact_reduce(p->communicator, &power, 1, error);
    *mean = p->area > 0.0 ? kiln_exact_value(&power, unit) / p->area : 0.0;
    return status;
}

/* Collective. Sums V and W over all points, relative to light. Relative errors above 1 count as 1. */
static int add_variances(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, double mean,
                         double sums[2], struct kiln_error *error)
{
    struct kiln_exact_sum exact[2] = {{0}, {0}};
    for (uint64_t i = 0; i < data->surface.count; i++) {
        const double light = fmax(kiln_part_light(data, i), KILN_PART_LEAST_LIGHT * mean),
                     own = (double)kiln_error_unpack(data->error[i]) / light,
                     parts = sqrt((double)variance_of(data->parts + KILN_PARTS * i)) / light;
        if (!(light > 0.0) || !kiln_point_valid(&data->surface, (struct kiln_own_point){i}))
            continue;
        kiln_exact_add(&exact[0], fmin(parts * parts, 1.0), 1.0 / UNIT);
        kiln_exact_add(&exact[1], fmin(own * own, 1.0), 1.0 / UNIT);
    }
    const int status = kiln_exact_reduce(p->communicator, exact, 2, error);
    for (int k = 0; k < 2; k++)
        sums[k] = kiln_exact_value(&exact[k], UNIT);
    return status;
}

int kiln_part_survey(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                     const struct kiln_step_reports *part, double unit, struct kiln_part_survey *survey,
                     struct kiln_error *error)
{
    double sums[2] = {0.0, 0.0};
    *survey = (struct kiln_part_survey){.shared = NULL};
    int status;
    KILN_TRY(find_mean(p, data, unit, &survey->mean, error));
    KILN_TRY(add_variances(p, data, survey->mean, sums, error));
    if (!kiln_has_rounds(p->settings))
        KILN_TRY(share(p, data, survey, error));
end:
    survey->gain = has_quarters(part) && sums[1] > sums[0]
                       ? sqrt(fmax(3.0 * sums[0] / (4.0 * sums[1] - sums[0]), GAIN_LEAST))
                       : 1.0;
    return status;
}

void kiln_part_errors(const struct kiln_rank_data *data, const struct kiln_tile_run *run,
                      const struct kiln_part_survey *survey, float errors[KILN_PART_ERRORS])
{
    float own[SIDE * SIDE];
    const float *tile = shared_of(survey, &data->surface, run);
    if (tile == NULL) {
        clear(own, SIDE * SIDE);
        lay_out(data, run, own);
        tile = own;
    }
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1)
        *errors++ = sqrtf((float)survey->gain * pooled(tile, kiln_part_place((uint32_t)__builtin_ctzll(rest))));
}

void kiln_part_survey_release(struct kiln_part_survey *survey)
{
    kiln_free(&survey->shared);
    kiln_free(&survey->shared_of);
}
