#include <math.h>

#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/published_windows.h"
#include "coordinator/integrate/parts/texel_loss.h"

enum { WHOLE = 230 }; /* least weight of a texel that is covered whole: charts are stretched */
#define UNSEEN 1.1    /* factor for errors that all parts share: blur of caustics, light that denoising moves */
#define SEEN_BIAS 9.0 /* a squared difference of denoised from raw light over its variance, from which it is bias */

/* Context of the calls of denoising. */
struct judging {
    struct kiln_published *p;
    const struct kiln_rank_data *data;
    uint64_t numbers[KILN_ERROR_BINS],
        raw[KILN_ERROR_BINS]; /* of points, by their error, and by what the same halves of raw light differ */
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
static uint64_t whole_places(const struct kiln_tile_light *t)
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
    const double dark = kiln_published_dark(j->p, j->data, run);
    struct kiln_tile_light t = {.there = 0};
    double bias = 0.0;
    uint32_t weight;
    kiln_tile_light_lay_out(j->p, &t, j->data, run, points);
    const double raw = kiln_published_raw_square(j->p, &t, dark, &weight, NULL);
    for (uint64_t rest = t.there; rest != 0; rest &= rest - 1) {
        const int place = __builtin_ctzll(rest);
        const struct kiln_window w = kiln_window_of(&t, place);
        const double allowed = fmax(w.light, dark),
                     noise = 0.5 * sqrt(j->p->gain) * (w.denoised[0] - w.denoised[1]) / allowed,
                     off = (0.5 * (w.denoised[0] + w.denoised[1]) -
                            0.25 * (w.part[0] + w.part[1] + w.part[2] + w.part[3])) /
                           allowed,
                     known = fmax(raw, kiln_window_variance(&w) / (allowed * allowed)),
                     square = off * off > SEEN_BIAS * known ? off * off - known : 0.0;
        if (allowed > 0.0 && t.weight[place] > 0) {
            bias += t.weight[place] * fmin(square, 1e12) / weight;
            j->numbers[kiln_error_bin(sqrt(noise * noise + square))] += t.weight[place];
            j->raw[kiln_error_bin(sqrt(j->p->gain) * fabs(kiln_window_contrast(&w, 0)) / allowed)] += t.weight[place];
        }
    }
    kiln_texel_losses_add(&j->losses, t.denoised[0], t.denoised[1], whole_places(&t), dark);
    j->p->bias[tile_run] = (float)sqrt(bias);
}

int kiln_published_denoised(struct kiln_published *p, const struct kiln_integrate_params *params,
                            const struct kiln_rank_data *data, double *reached, struct kiln_error *error)
{
    struct judging j = {.p = p, .data = data};
    const struct kiln_denoising_calls calls = {.give = give, .take = take, .context = &j};
    const int status = params->denoising->run(params->denoising->context, data, &calls, error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Allreduce(MPI_IN_PLACE, j.numbers, KILN_ERROR_BINS, MPI_UINT64_T, MPI_SUM, params->communicator);
    (void)MPI_Allreduce(MPI_IN_PLACE, j.losses.numbers, KILN_LOSS_BINS, MPI_UINT64_T, MPI_SUM, params->communicator);
    p->texel_loss = kiln_texel_losses_most(&j.losses);
    (void)MPI_Allreduce(MPI_IN_PLACE, j.raw, KILN_ERROR_BINS, MPI_UINT64_T, MPI_SUM, params->communicator);
    const double found = kiln_error_quantile(j.numbers), raw = kiln_error_quantile(j.raw),
                 gained = found > 0.0 && raw > 0.0 ? UNSEEN * found / raw : 1.0;
    *reached = gained * kiln_published_raw(p);
    kiln_published_rescale(p, *reached);
    return KILN_OK;
}
