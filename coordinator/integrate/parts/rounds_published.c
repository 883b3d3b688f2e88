#include "coordinator/integrate/parts/rounds_published.h"

#include <math.h>

#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/parts/published.h"
#include "coordinator/integrate/parts/round_senders.h"
#include "coordinator/integrate/parts/rounds_foretold.h"
#include "coordinator/integrate/parts/rounds.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

/* Adds the samples of the round that `last` ends. */
static void count_samples(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, uint32_t last)
{
    const uint32_t first = kiln_round_first(p->settings->samples_indirect, true);
    for (size_t i = 0; i < data->surface.tile_run_count; i++)
        data->samples_taken[i] = last < KILN_PARTS ? first : data->samples_taken[i] + data->samples[i];
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
    published->scale *= KILN_ROUND_DENOISED_USUAL;
    if (*reached > KILN_ROUND_JUDGED_WITHIN * p->settings->published_error)
        return KILN_OK;
    return kiln_published_denoised(published, p, data, reached, error);
}

/* Finds what tile runs need, in the field `samples`. Returns the points of those whose error is too large. */
static uint64_t find_needs(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                           struct kiln_published *published, struct kiln_caustics_need *caustics)
{
    uint64_t left = 0, all = 0, of_caustics = 0;
    const uint32_t first = kiln_round_first(p->settings->samples_indirect, true);
#pragma omp parallel for schedule(static) reduction(+ : left, all, of_caustics)
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const double over = kiln_published_of(published, i) / kiln_round_standard(p->settings), square = over * over,
                     share = square > 1.0 ? kiln_part_caustics_share(data, run) : 0.0;
        struct kiln_caustics_need need = {0};
        data->samples[i] = kiln_round_need(2.0 * (double)data->samples_taken[i] / first, square, share);
        if (!(square > 1.0))
            continue;
        kiln_caustics_need_add(&need, run->count, square, share);
        left += run->count;
        all += need.all;
        of_caustics += need.caustics;
    }
    for (size_t i = 0; i < data->surface.tile_run_count; i++)
        if (kiln_published_of(published, i) > kiln_round_standard(p->settings))
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

/* Collective. Foretells all rounds that follow, by some of the tile runs of each rank. */
static int foretell(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                    const struct kiln_published *published, double reached, uint32_t level,
                    struct kiln_foretold *foretold, struct kiln_error *error)
{
    const size_t runs = data->surface.tile_run_count, count = kiln_tried_tiles_bounded(p->communicator, runs);
    const double raw = kiln_published_raw_normal(published),
                 first = kiln_round_first(p->settings->samples_indirect, true);
    const bool judged = p->denoising != NULL && raw > 0.0 &&
                        kiln_published_raw(published) <= KILN_ROUND_JUDGED_WITHIN * p->settings->published_error;
    const struct kiln_foretell_from from = {.settings = p->settings,
                                            .level = level,
                                            .denoises = p->denoising != NULL,
                                            .scale = judged ? reached / raw : 0.0,
                                            .most = INFINITY};
    struct kiln_tried_tile *own = NULL, *all = NULL;
    size_t total = 0;
    int status = kiln_allocate(&own, count, sizeof *own, "the rounds to come", error);
    for (size_t k = 0; k < count && status == KILN_OK; k++) {
        const size_t i = (2 * k + 1) * runs / (2 * count);
        own[k] = (struct kiln_tried_tile){.raw = published->raw[i],
                                          .had = (float)(2.0 * (double)data->samples_taken[i] / first),
                                          .weight = published->weight[i],
                                          .points = data->surface.tile_runs[i].count};
    }
    status = kiln_agree(p->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_tried_tiles_gather(p->communicator, own, count, &all, &total, error);
    if (status == KILN_OK && total > 0)
        status = kiln_rounds_foretell(&from, all, total, foretold, error);
    kiln_free(&own);
    kiln_free(&all);
    return kiln_agree(p->communicator, status, error);
}

int kiln_round_judge_published(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                               const struct kiln_step_reports *part, double unit, struct kiln_round *round,
                               double *reached, double *texel_loss, struct kiln_caustics_need *caustics,
                               struct kiln_foretold *foretold, struct kiln_error *error)
{
    struct kiln_part_survey survey;
    struct kiln_published published = {.raw = NULL};
    uint64_t left = 0;
    int status;
    count_samples(p, data, part->of[part->count - 1].step.part);
    KILN_TRY(kiln_part_survey(p, data, part, unit, &survey, error));
    KILN_TRY(kiln_published_begin(&published, p, data, &survey, unit, error));
    KILN_TRY(find_reached(p, data, &published, reached, error));
    *texel_loss = published.texel_loss;
    left = find_needs(p, data, &published, caustics);
    (void)MPI_Allreduce(MPI_IN_PLACE, &left, 1, MPI_UINT64_T, MPI_SUM, p->communicator);
    kiln_published_gather(&published, p->communicator);
    KILN_TRY(foretell(p, data, &published, *reached, round->from, foretold, error));
    if (*reached > p->settings->published_error && left > 0)
        kiln_round_choose_published(p->settings, &published, round);
    if (round->to > 0) {
        KILN_TRY(kiln_round_senders(p, data, &survey, round, error));
        round->share = share_of(p, data, round);
    }
end:
    kiln_published_release(&published);
    kiln_part_survey_release(&survey);
    return status;
}
