#include "coordinator/integrate/parts/published.h"

#include <math.h>

#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/published_windows.h"
#include "coordinator/integrate/parts/tile_pool.h"
#include "coordinator/job/job.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

#define MOST_OF_SAMPLE 0x1p20 /* variance of a sample, relative to the squared light: more counts as that */

double kiln_published_raw_square(const struct kiln_published *p, const struct kiln_tile_light *t, double dark,
                                 uint32_t *weight, uint64_t *contrasts)
{
    double square = 0.0;
    *weight = 0;
    for (uint64_t rest = t->there; rest != 0; rest &= rest - 1) {
        const int place = __builtin_ctzll(rest);
        const struct kiln_window w = kiln_window_of(t, place);
        const double variance = p->gain * kiln_window_variance(&w), allowed = fmax(w.light, dark);
        square += variance > 0.0 ? t->weight[place] * fmin(variance / (allowed * allowed), 1e12) : 0.0;
        *weight += t->weight[place];
        for (int way = 0; contrasts != NULL && way < KILN_WINDOW_WAYS && allowed > 0.0; way++)
            contrasts[kiln_error_bin(sqrt(p->gain) * fabs(kiln_window_contrast(&w, way)) / allowed)] +=
                t->weight[place];
    }
    return *weight > 0 ? square / *weight : 0.0;
}

/* The squared errors of raw light of own tile runs, by their own texels. */
static void find_squares(struct kiln_published *p, const struct kiln_rank_data *data, double *squares)
{
#pragma omp parallel
    {
        uint64_t contrasts[KILN_ERROR_BINS] = {0};
#pragma omp for schedule(static)
        for (size_t i = 0; i < data->surface.tile_run_count; i++) {
            const struct kiln_tile_run *run = &data->surface.tile_runs[i];
            struct kiln_tile_light t;
            kiln_tile_light_lay_out(p, &t, data, run, NULL);
            squares[i] = kiln_published_raw_square(p, &t, kiln_published_dark(p, data, run), &p->weight[i], contrasts);
        }
#pragma omp critical(kiln_published_raw)
        for (size_t b = 0; b < KILN_ERROR_BINS; b++)
            p->contrasts[b] += contrasts[b];
    }
}

/* Collective. The errors of raw light of own tile runs, by the variance of a sample around each. */
static int find_raw(struct kiln_published *p, const struct kiln_integrate_params *params,
                    const struct kiln_rank_data *data, struct kiln_error *error)
{
    const size_t count = data->surface.tile_run_count;
    double *squares = NULL;
    int status = kiln_allocate(&squares, count, sizeof *squares, "the tiles' errors", error);
    KILN_TRY(kiln_agree(params->communicator, status, error));
    find_squares(p, data, squares);
    for (size_t i = 0; i < count; i++)
        squares[i] *= (double)data->samples_taken[i];
    KILN_TRY(kiln_tile_pool(params, &data->surface, MOST_OF_SAMPLE, p->weight, squares, error));
    for (size_t i = 0; i < count; i++) {
        p->raw[i] = (float)sqrt(squares[i] / (double)data->samples_taken[i]);
        p->numbers[kiln_error_bin((double)p->raw[i])] += p->weight[i];
    }
end:
    kiln_free(&squares);
    return status;
}

/* Collective. Mean luminance of each object, by area, times KILN_PUBLISHED_DARK; the mean area of its points. */
static int find_dark(struct kiln_published *p, const struct kiln_integrate_params *params,
                     const struct kiln_rank_data *data, double unit, struct kiln_error *error)
{
    const size_t objects = data->surface.object_count;
    struct kiln_exact_sum *sums = NULL;
    uint64_t *points = NULL;
    int status;
    KILN_TRY(kiln_allocate(&sums, 2 * objects, sizeof *sums, "the objects' light", error));
    KILN_TRY(kiln_allocate(&points, objects, sizeof *points, "the objects' points", error));
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const struct kiln_own_point first = kiln_own_of_global(&data->surface, run->first);
        struct kiln_exact_sum *of = &sums[2 * kiln_map_object(&data->surface, run->map)];
        for (uint64_t k = first.at; k < first.at + run->count && kiln_map_is_result(&data->surface, run->map); k++)
            if (kiln_point_valid(&data->surface, (struct kiln_own_point){k})) {
                const double area = (double)data->surface.area[k];
                kiln_exact_add(&of[0], area * kiln_part_light(data, k), 1.0 / unit);
                kiln_exact_add(&of[1], area, 1.0 / kiln_exact_unit(params->area));
                points[kiln_map_object(&data->surface, run->map)]++;
            }
    }
end:
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_exact_reduce(params->communicator, sums, 2 * objects, error);
    (void)MPI_Allreduce(MPI_IN_PLACE, points, status == KILN_OK ? (int)objects : 0, MPI_UINT64_T, MPI_SUM,
                        params->communicator);
    for (size_t o = 0; status == KILN_OK && o < objects; o++) {
        const double area = kiln_exact_value(&sums[2 * o + 1], kiln_exact_unit(params->area));
        p->dark[o] = area > 0.0 ? KILN_PUBLISHED_DARK * kiln_exact_value(&sums[2 * o], unit) / area : 0.0;
        p->texel[o] = points[o] > 0 ? area / (double)points[o] : 0.0;
    }
    kiln_free(&points);
    kiln_free(&sums);
    return status;
}

int kiln_published_allocate(struct kiln_published *p, size_t objects, size_t runs, struct kiln_error *error)
{
    int status;
    *p = (struct kiln_published){.gain = 1.0, .scale = 1.0};
    KILN_TRY(kiln_allocate(&p->dark, objects, sizeof *p->dark, "the objects' light", error));
    KILN_TRY(kiln_allocate(&p->texel, objects, sizeof *p->texel, "the objects' texels", error));
    KILN_TRY(kiln_allocate(&p->weight, runs, sizeof *p->weight, "the tiles' errors", error));
    KILN_TRY(kiln_allocate(&p->numbers, KILN_ERROR_BINS, sizeof *p->numbers, "the texels' errors", error));
    KILN_TRY(kiln_allocate(&p->contrasts, KILN_ERROR_BINS, sizeof *p->contrasts, "the texels' errors", error));
    KILN_TRY(kiln_allocate(&p->unfinished, KILN_ERROR_BINS, sizeof *p->unfinished, "the texels' errors", error));
    KILN_TRY(kiln_allocate(&p->raw, runs, sizeof *p->raw, "the tiles' errors", error));
    KILN_TRY(kiln_allocate(&p->bias, runs, sizeof *p->bias, "the tiles' errors", error));
end:
    return status;
}

int kiln_published_begin(struct kiln_published *p, const struct kiln_integrate_params *params,
                         const struct kiln_rank_data *data, const struct kiln_part_survey *survey, double unit,
                         struct kiln_error *error)
{
    int status = kiln_published_allocate(p, data->surface.object_count, data->surface.tile_run_count, error);
    p->survey = survey;
    p->gain = survey->gain;
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = find_dark(p, params, data, unit, error);
    if (status == KILN_OK)
        status = find_raw(p, params, data, error);
    (void)MPI_Allreduce(MPI_IN_PLACE, p->numbers, status == KILN_OK ? KILN_ERROR_BINS : 0, MPI_UINT64_T, MPI_SUM,
                        params->communicator);
    (void)MPI_Allreduce(MPI_IN_PLACE, p->contrasts, status == KILN_OK ? KILN_ERROR_BINS : 0, MPI_UINT64_T, MPI_SUM,
                        params->communicator);
    return status;
}

double kiln_published_raw(const struct kiln_published *p) { return kiln_error_quantile(p->contrasts); }

double kiln_published_raw_normal(const struct kiln_published *p) { return kiln_error_normal_quantile(p->numbers); }

double kiln_published_raw_of_those(const struct kiln_published *p) { return kiln_error_normal_quantile(p->unfinished); }

void kiln_published_rescale(struct kiln_published *p, double reached)
{
    const double normal = kiln_published_raw_normal(p);
    p->scale = reached > 0.0 && normal > 0.0 ? reached / normal : 1.0;
}

/* ---- the next round ---- */

double kiln_published_of(const struct kiln_published *p, size_t tile_run)
{
    const double raw = p->scale * (double)p->raw[tile_run], bias = (double)p->bias[tile_run];
    return sqrt(raw * raw + bias * bias);
}

void kiln_published_goes_on(struct kiln_published *p, size_t tile_run)
{
    p->unfinished[kiln_error_bin((double)p->raw[tile_run])] += p->weight[tile_run];
}

void kiln_published_gather(struct kiln_published *p, MPI_Comm communicator)
{
    (void)MPI_Allreduce(MPI_IN_PLACE, p->unfinished, KILN_ERROR_BINS, MPI_UINT64_T, MPI_SUM, communicator);
}

double kiln_published_expected(const struct kiln_published *p, double times, double enough, double x)
{
    const double all = kiln_error_number(p->numbers),
                 above = kiln_error_number_above(p->numbers, p->scale, 0.0, x) -
                         kiln_error_number_above(p->unfinished, p->scale, 0.0, x) +
                         kiln_error_number_above(p->unfinished, p->scale / sqrt(times), enough, x);
    return all > 0.0 ? above / all : 0.0;
}

void kiln_published_release(struct kiln_published *p)
{
    kiln_free(&p->dark);
    kiln_free(&p->texel);
    kiln_free(&p->weight);
    kiln_free(&p->numbers);
    kiln_free(&p->contrasts);
    kiln_free(&p->unfinished);
    kiln_free(&p->raw);
    kiln_free(&p->bias);
}
