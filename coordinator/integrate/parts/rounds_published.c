#include "coordinator/integrate/parts/rounds_published.h"

#include <math.h>

#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/parts/published.h"
#include "coordinator/integrate/parts/round_senders.h"
#include "coordinator/integrate/parts/rounds.h"

enum {
    LEVELS_MOST = 2,       /* most levels of a round: its gathers read light that the round before has found */
    SAMPLES_MOST = 1 << 15 /* of a step of a part, without --time */
};
#define OF_PUBLISHED 0.5 /* standard error over a target that 95.45 % of normal errors stay below */
#define WITHIN 4.0       /* raw error over the error asked for, above which light is not denoised to judge it */
#define SCALE_USUAL 0.5  /* error of denoised light over that of raw light, where it is not known */
#define AIM 0.93         /* error that a round aims at, over the error asked for: else many would miss it by little */
/* tile runs are finished at this fraction of what is allowed: finer light gains less from denoising */
#define FINISHED 0.8
#define OWN_LEAST 0.5 /* of the variance that is allowed: what caustics leave for other light */

/* The standard error with which a tile run is finished. */
static double standard_of(const struct kiln_integrate_settings *settings)
{
    return OF_PUBLISHED * FINISHED * settings->published_error;
}

/* Adds the samples of the round that `last` ends. */
static void count_samples(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, uint32_t last)
{
    const uint32_t first = kiln_round_first(p->settings->samples_indirect, true);
    for (size_t i = 0; i < data->surface.tile_run_count; i++)
        data->samples_taken[i] = last < KILN_PARTS ? first : data->samples_taken[i] + data->samples[i];
}

/* Samples that a tile run needs beyond those it has had, in halves of those of the first round. `square`: its variance
 * over the allowed one, of which caustics, which have samples of their own, have a share. */
static uint32_t need_of(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, size_t i,
                        double square, double caustics)
{
    const double had = 2.0 * (double)data->samples_taken[i] / kiln_round_first(p->settings->samples_indirect, true),
                 own = square * (1.0 - caustics), allowed = fmax(1.0 - square * caustics, OWN_LEAST),
                 need = ceil(had * (own / allowed - 1.0));
    return own > allowed ? (uint32_t)fmin(fmax(need, 1.0), 0x1p31) : 0;
}

/* The least level at which the error is expected to be small enough. */
static void choose_level(const struct kiln_integrate_params *p, const struct kiln_published *published,
                         struct kiln_round *round)
{
    const uint64_t first = kiln_round_most_first(p->settings),
                   most = p->settings->time > 0.0 ? KILN_ROUND_SAMPLES_MOST : SAMPLES_MOST;
    const uint32_t now = round->from;
    for (uint32_t l = now + 1; l < KILN_ROUND_LEVELS && l <= now + LEVELS_MOST; l++) {
        const double times = (double)kiln_round_times(l) / (double)kiln_round_times(now);
        if (first / 2 * kiln_round_times(l) > most)
            break;
        round->to = l;
        if (kiln_published_expected(published, times, standard_of(p->settings), AIM * p->settings->published_error) <=
            1.0 - KILN_PUBLISHED_SHARE)
            break;
    }
}

/* Collective. The error of published light, relative. What lies far above the error asked for is not denoised to know
 * that. */
static int find_reached(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                        struct kiln_published *published, double *reached, struct kiln_error *error)
{
    *reached = kiln_published_raw(published);
    kiln_published_rescale(published, *reached);
    if (p->denoising == NULL)
        return KILN_OK;
    published->scale *= SCALE_USUAL;
    if (*reached > WITHIN * p->settings->published_error)
        return KILN_OK;
    return kiln_published_denoised(published, p, data, reached, error);
}

/* Finds what tile runs need, in the field `samples`. Returns the points of those whose error is too large. */
static uint64_t find_needs(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                           struct kiln_published *published, struct kiln_caustics_need *caustics)
{
    uint64_t left = 0, all = 0, of_caustics = 0;
#pragma omp parallel for schedule(static) reduction(+ : left, all, of_caustics)
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const double over = kiln_published_of(published, i) / standard_of(p->settings), square = over * over,
                     share = square > 1.0 ? kiln_part_caustics_share(data, run) : 0.0;
        struct kiln_caustics_need need = {0};
        data->samples[i] = need_of(p, data, i, square, share);
        if (!(square > 1.0))
            continue;
        kiln_caustics_need_add(&need, run->count, square, share);
        left += run->count;
        all += need.all;
        of_caustics += need.caustics;
    }
    for (size_t i = 0; i < data->surface.tile_run_count; i++)
        if (kiln_published_of(published, i) > standard_of(p->settings))
            kiln_published_goes_on(published, i);
    *caustics = (struct kiln_caustics_need){left, all, of_caustics};
    return left;
}

/* Collective. What the round takes over what it would take if all tile runs had all of its samples. */
static double share_of(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                       const struct kiln_round *round)
{
    const uint64_t more = kiln_round_times(round->to) - kiln_round_times(round->from);
    uint64_t work = 0;
    for (size_t i = 0; i < data->surface.tile_run_count; i++)
        work += (uint64_t)data->surface.tile_runs[i].count * kiln_round_units(data->samples[i], more);
    (void)MPI_Allreduce(MPI_IN_PLACE, &work, 1, MPI_UINT64_T, MPI_SUM, p->communicator);
    return (double)work / ((double)more * (double)p->surface->point_count);
}

int kiln_round_judge_published(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                               const struct kiln_step_reports *part, double unit, struct kiln_round *round,
                               double *reached, double *texel_loss, struct kiln_caustics_need *caustics,
                               struct kiln_error *error)
{
    struct kiln_part_survey survey;
    struct kiln_published published = {.raw = NULL};
    uint64_t left = 0;
    int status;
    KILN_TRY(kiln_part_survey(p, data, part, unit, &survey, error));
    KILN_TRY(kiln_published_begin(&published, p, data, &survey, unit, error));
    KILN_TRY(find_reached(p, data, &published, reached, error));
    *texel_loss = published.texel_loss;
    count_samples(p, data, part->of[part->count - 1].step.part);
    left = find_needs(p, data, &published, caustics);
    (void)MPI_Allreduce(MPI_IN_PLACE, &left, 1, MPI_UINT64_T, MPI_SUM, p->communicator);
    kiln_published_gather(&published, p->communicator);
    if (*reached > p->settings->published_error && left > 0)
        choose_level(p, &published, round);
    if (round->to > 0) {
        KILN_TRY(kiln_round_senders(p, data, &survey, round, error));
        round->share = share_of(p, data, round);
    }
end:
    kiln_published_release(&published);
    kiln_part_survey_release(&survey);
    return status;
}
