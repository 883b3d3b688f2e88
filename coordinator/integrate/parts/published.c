#include "coordinator/integrate/parts/published.h"

#include <math.h>

#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/texel_loss.h"
#include "coordinator/job/job.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum {
    WAYS = KILN_PARTS - 1, /* to halve the parts */
    REACH = 2,             /* texels to each side of an eye's mean */
    SIDE = 8,              /* of a tile, texels */
    FULL = 255,            /* weight of a texel that is covered whole */
    WHOLE = 230,           /* likewise, at least: charts are stretched */
    BINS = 512             /* of errors, by their logarithm */
};
#define DARK 0.05        /* of an object's mean */
#define BIN_LEAST 1e-6   /* relative error of the first bin */
#define BIN_STEP 0.03125 /* of the natural logarithm */
#define UNSEEN 1.1       /* factor for errors that all parts share: blur of caustics, light that denoising moves */
#define SEEN_BIAS 9.0    /* a squared difference of denoised from raw light over its variance, from which it is bias */

/* A tile run's light at its places in the tile. */
struct tile_light {
    float part[KILN_PARTS][SIDE * SIDE];
    float all[SIDE * SIDE];
    float denoised[KILN_HALVES][SIDE * SIDE];
    uint32_t weight[SIDE * SIDE];
    uint64_t there; /* places with light */
};

/* Means over the texels around a texel. */
struct window {
    double light, part[KILN_PARTS], denoised[KILN_HALVES];
};

/* The area of a whole texel, m2: the largest in the tile, or the object's mean where a tile has but edges of charts. */
static double whole_texel(const struct kiln_published *p, const struct kiln_rank_data *data,
                          const struct kiln_tile_run *run)
{
    const uint64_t first = kiln_own_of_global(&data->surface, run->first).at;
    double most = p->texel[kiln_map_object(&data->surface, run->map)];
    for (uint64_t k = first; k < first + run->count; k++)
        most = fmax(most, (double)data->surface.area[k]);
    return most;
}

static void lay_out(const struct kiln_published *p, struct tile_light *t, const struct kiln_rank_data *data,
                    const struct kiln_tile_run *run, const struct kiln_halves *denoised)
{
    const double whole = whole_texel(p, data, run);
    const bool shown = kiln_map_is_result(&data->surface, run->map);
    struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
    size_t k = 0;
    t->there = 0;
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++, k++) {
        const int place = kiln_part_place((uint32_t)__builtin_ctzll(rest));
        if (!kiln_point_valid(&data->surface, own))
            continue;
        t->there |= (uint64_t)1u << place;
        t->weight[place] = !shown ? 0 : (uint32_t)ceil(FULL * fmin((double)data->surface.area[own.at] / whole, 1.0));
        t->all[place] = (float)kiln_part_light(data, own.at);
        for (int i = 0; i < KILN_PARTS; i++)
            t->part[i][place] = data->parts[KILN_PARTS * own.at + (uint64_t)i];
        for (int h = 0; h < KILN_HALVES; h++)
            t->denoised[h][place] = denoised != NULL ? denoised[k].light[h] : 0.0f;
    }
}

/* The window of a texel lies within the tile, so that it has all its texels. */
static int window_first(int at)
{
    const int first = at - REACH, last = SIDE - 2 * REACH - 1;
    return first < 0 ? 0 : first > last ? last : first;
}

static struct window window_of(const struct tile_light *t, int place)
{
    const int u = window_first(place % SIDE), v = window_first(place / SIDE);
    struct window w = {.light = 0.0};
    double count = 0.0;
    if (t->weight[place] == 0) /* it is not looked at */
        return w;
    for (int y = v; y <= v + 2 * REACH; y++)
        for (int x = u; x <= u + 2 * REACH; x++) {
            const int at = y * SIDE + x;
            if ((t->there >> at & 1u) == 0)
                continue;
            const double weight = t->weight[at];
            count += weight;
            w.light += weight * (double)t->all[at];
            for (int k = 0; k < KILN_PARTS; k++)
                w.part[k] += weight * (double)t->part[k][at];
            for (int h = 0; h < KILN_HALVES; h++)
                w.denoised[h] += weight * (double)t->denoised[h][at];
        }
    w.light /= count;
    for (int k = 0; k < KILN_PARTS; k++)
        w.part[k] /= count;
    for (int h = 0; h < KILN_HALVES; h++)
        w.denoised[h] /= count;
    return w;
}

/* Variance of the mean of the parts. */
static double variance_of(const struct window *w)
{
    double mean = 0.0, square = 0.0;
    for (int k = 0; k < KILN_PARTS; k++)
        mean += w->part[k] / KILN_PARTS;
    for (int k = 0; k < KILN_PARTS; k++)
        square += (w->part[k] - mean) * (w->part[k] - mean);
    return square / (KILN_PARTS * (KILN_PARTS - 1));
}

static size_t bin_of(double error)
{
    const double at = log(fmax(error, BIN_LEAST) / BIN_LEAST) / BIN_STEP;
    return at >= BINS - 1 ? BINS - 1 : (size_t)at;
}

static double middle_of(size_t bin) { return BIN_LEAST * exp(((double)bin + 0.5) * BIN_STEP); }

static double dark_of(const struct kiln_published *p, const struct kiln_rank_data *data,
                      const struct kiln_tile_run *run)
{
    return p->dark[kiln_map_object(&data->surface, run->map)];
}

/* Mean over a tile run's points of the squared relative error of raw light; *weight: of them all. */
static double raw_square(const struct kiln_published *p, const struct tile_light *t, double dark, uint32_t *weight)
{
    double square = 0.0;
    *weight = 0;
    for (uint64_t rest = t->there; rest != 0; rest &= rest - 1) {
        const int place = __builtin_ctzll(rest);
        const struct window w = window_of(t, place);
        const double variance = p->gain * variance_of(&w), allowed = fmax(w.light, dark);
        square += variance > 0.0 ? t->weight[place] * fmin(variance / (allowed * allowed), 1e12) : 0.0;
        *weight += t->weight[place];
    }
    return *weight > 0 ? square / *weight : 0.0;
}

/* ---- raw light ---- */

/* What two halves of the parts differ by, over 2: as large as the error of their mean. `way`: which of the other parts
 * is with part 0. */
static double contrast_of(const struct window *w, int way)
{
    double sum = w->part[0];
    for (int k = 1; k < KILN_PARTS; k++)
        sum += k - 1 == way ? w->part[k] : -w->part[k];
    return sum / KILN_PARTS;
}

/* Counts texels of a tile by what halves of the parts differ by, in all ways. */
static void add_contrasts(const struct kiln_published *p, const struct tile_light *t, double dark,
                          uint64_t numbers[BINS])
{
    for (uint64_t rest = t->there; rest != 0; rest &= rest - 1) {
        const int place = __builtin_ctzll(rest);
        const struct window w = window_of(t, place);
        const double allowed = fmax(w.light, dark);
        for (int way = 0; way < WAYS && allowed > 0.0; way++)
            numbers[bin_of(sqrt(p->gain) * fabs(contrast_of(&w, way)) / allowed)] += t->weight[place];
    }
}

static void find_raw(struct kiln_published *p, const struct kiln_rank_data *data)
{
#pragma omp parallel
    {
        uint64_t numbers[BINS] = {0}, contrasts[BINS] = {0};
#pragma omp for schedule(static)
        for (size_t i = 0; i < data->surface.tile_run_count; i++) {
            const struct kiln_tile_run *run = &data->surface.tile_runs[i];
            const double dark = dark_of(p, data, run);
            struct tile_light t;
            lay_out(p, &t, data, run, NULL);
            p->raw[i] = (float)sqrt(raw_square(p, &t, dark, &p->weight[i]));
            numbers[bin_of((double)p->raw[i])] += p->weight[i];
            add_contrasts(p, &t, dark, contrasts);
        }
#pragma omp critical(kiln_published_raw)
        for (size_t b = 0; b < BINS; b++) {
            p->numbers[b] += numbers[b];
            p->contrasts[b] += contrasts[b];
        }
    }
}

/* Collective. Mean luminance of each object, by area, times DARK; the mean area of its points. */
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
        p->dark[o] = area > 0.0 ? DARK * kiln_exact_value(&sums[2 * o], unit) / area : 0.0;
        p->texel[o] = points[o] > 0 ? area / (double)points[o] : 0.0;
    }
    kiln_free(&points);
    kiln_free(&sums);
    return status;
}

int kiln_published_begin(struct kiln_published *p, const struct kiln_integrate_params *params,
                         const struct kiln_rank_data *data, const struct kiln_part_survey *survey, double unit,
                         struct kiln_error *error)
{
    const size_t runs = data->surface.tile_run_count;
    int status;
    *p = (struct kiln_published){.survey = survey, .gain = survey->gain, .scale = 1.0};
    KILN_TRY(kiln_allocate(&p->dark, data->surface.object_count, sizeof *p->dark, "the objects' light", error));
    KILN_TRY(kiln_allocate(&p->texel, data->surface.object_count, sizeof *p->texel, "the objects' texels", error));
    KILN_TRY(kiln_allocate(&p->weight, runs, sizeof *p->weight, "the tiles' errors", error));
    KILN_TRY(kiln_allocate(&p->numbers, BINS, sizeof *p->numbers, "the texels' errors", error));
    KILN_TRY(kiln_allocate(&p->contrasts, BINS, sizeof *p->contrasts, "the texels' errors", error));
    KILN_TRY(kiln_allocate(&p->unfinished, BINS, sizeof *p->unfinished, "the texels' errors", error));
    KILN_TRY(kiln_allocate(&p->raw, runs, sizeof *p->raw, "the tiles' errors", error));
    KILN_TRY(kiln_allocate(&p->bias, runs, sizeof *p->bias, "the tiles' errors", error));
end:
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = find_dark(p, params, data, unit, error);
    if (status == KILN_OK)
        find_raw(p, data);
    (void)MPI_Allreduce(MPI_IN_PLACE, p->numbers, status == KILN_OK ? BINS : 0, MPI_UINT64_T, MPI_SUM,
                        params->communicator);
    (void)MPI_Allreduce(MPI_IN_PLACE, p->contrasts, status == KILN_OK ? BINS : 0, MPI_UINT64_T, MPI_SUM,
                        params->communicator);
    return status;
}

/* Number of points whose error is above x, if errors of bins are times `scale`, and `least` at least. */
static double number_above(const uint64_t *numbers, double scale, double least, double x)
{
    double above = 0.0;
    for (size_t b = 0; b < BINS; b++)
        if (numbers[b] > 0)
            above += (double)numbers[b] * erfc(x / (sqrt(2.0) * fmax(scale * middle_of(b), least)));
    return above;
}

static double number_of(const uint64_t *numbers)
{
    double all = 0.0;
    for (size_t b = 0; b < BINS; b++)
        all += (double)numbers[b];
    return all;
}

/* The error that a share of the points stay below, errors of bins being standard errors. */
static double normal_quantile(const uint64_t *numbers)
{
    const double most = (1.0 - KILN_PUBLISHED_SHARE) * number_of(numbers);
    double low = 0.0, high = 4.0 * BIN_LEAST * exp(BINS * BIN_STEP);
    for (int i = 0; i < 60; i++) {
        const double middle = 0.5 * (low + high);
        if (number_above(numbers, 1.0, 0.0, middle) > most)
            low = middle;
        else
            high = middle;
    }
    return high;
}

/* The error that a share of the points stay below. */
static double quantile(const uint64_t numbers[BINS])
{
    const double all = number_of(numbers);
    double below = 0.0;
    size_t b = 0;
    while (b < BINS - 1 && below + (double)numbers[b] < KILN_PUBLISHED_SHARE * all)
        below += (double)numbers[b++];
    const double within = numbers[b] > 0 ? (KILN_PUBLISHED_SHARE * all - below) / (double)numbers[b] : 0.0;
    return all > 0.0 ? BIN_LEAST * exp(((double)b + within) * BIN_STEP) : 0.0;
}

double kiln_published_raw(const struct kiln_published *p) { return quantile(p->contrasts); }

double kiln_published_raw_normal(const struct kiln_published *p) { return normal_quantile(p->numbers); }

double kiln_published_raw_of_those(const struct kiln_published *p) { return normal_quantile(p->unfinished); }

/* ---- denoised light ---- */

/* Context of the calls of denoising. */
struct judging {
    struct kiln_published *p;
    const struct kiln_rank_data *data;
    uint64_t numbers[BINS], raw[BINS]; /* of points, by their error, and by what the same halves of raw light differ */
    struct kiln_texel_losses losses;
};

static void give(void *context, size_t tile_run, struct kiln_halves *points)
{
    const struct judging *j = context;
    const struct kiln_tile_run *run = &j->data->surface.tile_runs[tile_run];
    const uint64_t first = kiln_own_of_global(&j->data->surface, run->first).at;
    float errors[KILN_PART_ERRORS];
    kiln_part_errors(j->data, run, j->p->survey, errors);
    for (uint32_t k = 0; k < run->count; k++) {
        const float *parts = j->data->parts + KILN_PARTS * (first + k);
        points[k] = (struct kiln_halves){.light = {0.5f * (parts[0] + parts[1]), 0.5f * (parts[2] + parts[3])},
                                         .variance = 2.0f * errors[k] * errors[k]};
    }
}

/* Places of texels that are covered whole. */
static uint64_t whole_places(const struct tile_light *t)
{
    uint64_t whole = 0;
    for (uint64_t rest = t->there; rest != 0; rest &= rest - 1)
        if (t->weight[__builtin_ctzll(rest)] >= WHOLE)
            whole |= rest & (~rest + 1);
    return whole;
}

static void take(void *context, size_t tile_run, const struct kiln_halves *points)
{
    struct judging *j = context;
    const struct kiln_tile_run *run = &j->data->surface.tile_runs[tile_run];
    const double dark = dark_of(j->p, j->data, run);
    struct tile_light t;
    double bias = 0.0;
    uint32_t weight;
    lay_out(j->p, &t, j->data, run, points);
    const double raw = raw_square(j->p, &t, dark, &weight);
    for (uint64_t rest = t.there; rest != 0; rest &= rest - 1) {
        const int place = __builtin_ctzll(rest);
        const struct window w = window_of(&t, place);
        const double allowed = fmax(w.light, dark),
                     noise = 0.5 * sqrt(j->p->gain) * (w.denoised[0] - w.denoised[1]) / allowed,
                     off = (0.5 * (w.denoised[0] + w.denoised[1]) -
                            0.25 * (w.part[0] + w.part[1] + w.part[2] + w.part[3])) /
                           allowed,
                     known = fmax(raw, variance_of(&w) / (allowed * allowed)),
                     square = off * off > SEEN_BIAS * known ? off * off - known : 0.0;
        if (allowed > 0.0) {
            bias += t.weight[place] * fmin(square, 1e12) / weight;
            j->numbers[bin_of(sqrt(noise * noise + square))] += t.weight[place];
            j->raw[bin_of(sqrt(j->p->gain) * fabs(contrast_of(&w, 0)) / allowed)] += t.weight[place];
        }
    }
    kiln_texel_losses_add(&j->losses, t.denoised[0], t.denoised[1], whole_places(&t), dark);
    j->p->bias[tile_run] = (float)sqrt(bias);
}

void kiln_published_rescale(struct kiln_published *p, double reached)
{
    const double normal = kiln_published_raw_normal(p);
    p->scale = reached > 0.0 && normal > 0.0 ? reached / normal : 1.0;
}

int kiln_published_denoised(struct kiln_published *p, const struct kiln_integrate_params *params,
                            const struct kiln_rank_data *data, double *reached, struct kiln_error *error)
{
    struct judging j = {.p = p, .data = data};
    const struct kiln_denoising_calls calls = {.give = give, .take = take, .context = &j};
    const int status = params->denoising->run(params->denoising->context, data, &calls, error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Allreduce(MPI_IN_PLACE, j.numbers, BINS, MPI_UINT64_T, MPI_SUM, params->communicator);
    (void)MPI_Allreduce(MPI_IN_PLACE, j.losses.numbers, KILN_LOSS_BINS, MPI_UINT64_T, MPI_SUM, params->communicator);
    p->texel_loss = kiln_texel_losses_most(&j.losses);
    (void)MPI_Allreduce(MPI_IN_PLACE, j.raw, BINS, MPI_UINT64_T, MPI_SUM, params->communicator);
    const double found = quantile(j.numbers), raw = quantile(j.raw),
                 gained = found > 0.0 && raw > 0.0 ? UNSEEN * found / raw : 1.0;
    *reached = gained * kiln_published_raw(p);
    kiln_published_rescale(p, *reached);
    return KILN_OK;
}

/* ---- the next round ---- */

double kiln_published_of(const struct kiln_published *p, size_t tile_run)
{
    const double raw = p->scale * (double)p->raw[tile_run], bias = (double)p->bias[tile_run];
    return sqrt(raw * raw + bias * bias);
}

void kiln_published_goes_on(struct kiln_published *p, size_t tile_run)
{
    p->unfinished[bin_of((double)p->raw[tile_run])] += p->weight[tile_run];
}

void kiln_published_gather(struct kiln_published *p, MPI_Comm communicator)
{
    (void)MPI_Allreduce(MPI_IN_PLACE, p->unfinished, BINS, MPI_UINT64_T, MPI_SUM, communicator);
}

double kiln_published_expected(const struct kiln_published *p, double times, double enough, double x)
{
    const double all = number_of(p->numbers), above = number_above(p->numbers, p->scale, 0.0, x) -
                                                      number_above(p->unfinished, p->scale, 0.0, x) +
                                                      number_above(p->unfinished, p->scale / sqrt(times), enough, x);
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
