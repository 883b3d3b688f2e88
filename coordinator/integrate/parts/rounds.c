#include "coordinator/integrate/parts/rounds.h"

#include <math.h>

#include "coordinator/integrate/parts/part_caustics.h"
#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/parts/rounds_published.h"
#include "coordinator/integrate/parts/rounds_time.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum {
    WHOLE = 2 /* levels to twice the samples */
};
#define LEFT 0.025         /* fraction of points that may lie in unfinished tile runs */
#define MORE 0.1           /* fraction of unfinished points that may get more samples than they need */
#define NEAREST 0.70710678 /* of twice the samples */

/* ---- samples ---- */

const struct kiln_round *kiln_round_of(const struct kiln_step_report *reports, size_t count)
{
    size_t first = count;
    while (first > 0 && reports[first - 1].step.part / KILN_PARTS == reports[count - 1].step.part / KILN_PARTS)
        first--;
    return first > 0 ? &reports[first - 1].round : NULL;
}

bool kiln_round_is_sane(const struct kiln_round *round)
{
    return round->from < KILN_ROUND_LEVELS && round->to < KILN_ROUND_LEVELS && round->share >= 0.0 &&
           round->share <= 1.0 && round->caustics_from <= round->caustics_to && round->caustics_to < KILN_ROUND_LEVELS;
}

struct kiln_round kiln_round_of_caustics(const struct kiln_round *round)
{
    return (struct kiln_round){.from = round->caustics_from, .to = round->caustics_to, .share = round->share};
}

void kiln_round_share(const struct kiln_round *round, uint32_t own, bool counts, struct kiln_step *step)
{
    const uint64_t before = kiln_round_times(round->from),
                   more = round->to > 0 ? kiln_round_times(round->to) - before : 0;
    const uint32_t first = step->samples;
    if (counts) {
        step->samples = (uint32_t)(first / 2 * more);
        step->first_sample = (uint32_t)(first / 2 * before) * KILN_PARTS + own * step->samples;
        /* caustics have the same samples everywhere, since finished tile runs need them, too */
        step->samples_field = step->pass == &kiln_pass_direct ? KILN_FIELD_SAMPLES_DIRECT
                              : step->terminal                ? KILN_FIELD_SAMPLES
                                                              : NULL;
    } else { /* sample indices are spaced for twice as many samples, so that no two rounds share any */
        step->samples = (uint32_t)ceil(0.5 * (double)(first * more) * round->share);
        step->first_sample = (uint32_t)(first * before) * KILN_PARTS + own * step->samples;
    }
}

/* ---- the target ---- */

/* Target that tile runs are judged by. */
struct target {
    struct kiln_part_survey survey;
    double relative; /* error over luminance */
};

/* Mean square of a tile run's errors, relative to the allowed error. */
static double mean_square(const struct kiln_rank_data *data, const struct kiln_tile_run *run, const struct target *t)
{
    const struct kiln_own_point first = kiln_own_of_global(&data->surface, run->first);
    double square = 0.0, valid = 0.0;
    float errors[KILN_PART_ERRORS];
    kiln_part_errors(data, run, &t->survey, errors);
    for (uint32_t k = 0; k < run->count; k++) {
        if (!kiln_point_valid(&data->surface, (struct kiln_own_point){first.at + k}))
            continue;
        const double allowed = t->relative *
                               fmax(kiln_part_light(data, first.at + k), KILN_PART_LEAST_LIGHT * t->survey.mean),
                     ratio = errors[k] > 0.0f ? (double)errors[k] / allowed : 0.0;
        square += fmin(ratio * ratio, 1e30);
        valid += 1.0;
    }
    return valid > 0.0 ? square / valid : 0.0;
}

/* ---- the next round ---- */

/* The level at which a tile run is expected to be finished. */
static uint32_t level_needed(uint32_t level, double square)
{
    uint32_t needed = level + 1;
    for (; needed < KILN_ROUND_LEVELS - 1; needed++) {
        const double times = (double)kiln_round_times(needed) / (double)kiln_round_times(level);
        if (times * sqrt(times) >= square)
            break;
    }
    return needed;
}

/* Chooses the level of caustics in a round whose other levels are known: the nearest to what is wanted. `growth`:
 * kiln_caustics_growth. */
static void choose_caustics(struct kiln_round *round, double growth)
{
    const double wanted = growth * (double)kiln_round_times(round->to) / (double)kiln_round_times(round->from),
                 from = (double)kiln_round_times(round->caustics_from);
    uint32_t to = round->caustics_from;
    while (round->to > 0 && to < round->caustics_from + KILN_ROUND_LEVELS_MOST && to + WHOLE < KILN_ROUND_LEVELS &&
           wanted >= NEAREST * (double)kiln_round_times(to + WHOLE) / from)
        to += WHOLE;
    round->caustics_to = to;
}

/* Numbers of unfinished points, by the level at which they are expected to be finished. */
struct needs {
    uint64_t points[KILN_ROUND_LEVELS];
};

static void choose_level(const struct kiln_integrate_params *p, const struct needs *needs, struct kiln_round *round)
{
    const uint64_t first = kiln_round_most_first(p->settings), points = p->surface->point_count;
    const uint32_t now = round->from;
    uint64_t unfinished = 0, below = 0;
    for (uint32_t l = 0; l < KILN_ROUND_LEVELS; l++)
        unfinished += needs->points[l];
    round->share = points > 0 ? (double)unfinished / (double)points : 0.0;
    if (round->share <= LEFT)
        return;
    for (uint32_t l = now + 1; l < KILN_ROUND_LEVELS && l <= now + KILN_ROUND_LEVELS_MOST; l++) {
        if (first / 2 * kiln_round_times(l) > KILN_ROUND_SAMPLES_MOST || (double)below > MORE * (double)unfinished)
            break;
        below += needs->points[l];
        round->to = l;
    }
}

/* The samples of a tile run in the terminal steps and in direct light of the next round, which has `more` halves of the
 * samples of the first round. `units`: what the tile run takes of these; 0: it is finished. */
static void set_samples(const struct kiln_integrate_settings *settings, const struct kiln_rank_data *data, size_t i,
                        uint64_t more, uint32_t units)
{
    const uint64_t direct = kiln_round_first(settings->samples_direct, true),
                   final = kiln_round_first(settings->samples_indirect, true);
    const bool needed = data->parts_radiosity == NULL; /* for the bounces of another solve */
    const uint64_t of_finished = !needed ? 0 : direct / 2 * more > direct ? direct : direct / 2 * more;
    data->samples[i] = (uint32_t)(final / 2 * units);
    data->samples_direct[i] = (uint32_t)(units > 0 ? direct / 2 * units : of_finished);
}

/* A round that begins at the levels of the one that the last report is of. */
static struct kiln_round round_after(const struct kiln_step_reports *steps)
{
    const struct kiln_round *before = kiln_round_of(steps->of, steps->count);
    return before != NULL ? (struct kiln_round){.from = before->to, .caustics_from = before->caustics_to}
                          : (struct kiln_round){.from = 0};
}

/* Collective. What caustics should grow by, relative to all other samples. */
static double growth_of_caustics(const struct kiln_integrate_params *p, const struct kiln_round *round,
                                 struct kiln_caustics_need *need)
{
    const uint64_t points = p->surface->point_count;
    kiln_caustics_need_reduce(need, p->communicator);
    return points == 0
               ? 0.0
               : kiln_caustics_growth(need, (double)kiln_round_times(round->caustics_from),
                                      (double)kiln_round_times(round->from), (double)need->points / (double)points);
}

/* Collective. Judges tile runs by a target error. Marks in the field `samples` those that go on, and chooses the next
 * round. */
static int judge_target(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                        const struct kiln_step_reports *part, double unit, struct kiln_round *round,
                        struct kiln_error *error)
{
    struct target t = {.relative = p->settings->target_error};
    struct needs needs = {{0}};
    const uint32_t last = part->of[part->count - 1].step.part;
    const int status = kiln_part_survey(p, data, part, unit, &t.survey, error);
    for (size_t i = 0; status == KILN_OK && i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const double square = mean_square(data, run, &t);
        const bool finished = square <= 1.0 || !kiln_part_changes(data, run, last);
        needs.points[finished ? 0 : level_needed(round->from, square)] += finished ? 0 : run->count;
        data->samples[i] = finished ? 0 : UINT32_MAX;
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, needs.points, KILN_ROUND_LEVELS, MPI_UINT64_T, MPI_SUM, p->communicator);
    choose_level(p, &needs, round);
    kiln_part_survey_release(&t.survey);
    return status;
}

int kiln_round_judge(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, double unit,
                     struct kiln_step_reports *steps, struct kiln_error *error)
{
    struct kiln_step_report *last = &steps->of[steps->count - 1];
    const struct kiln_step_reports part = kiln_part_reports(steps);
    const bool published = p->settings->published_error > 0.0;
    struct kiln_caustics_need caustics = {0};
    struct kiln_round round = round_after(steps);
    struct kiln_foretold foretold = {.tried = 0};
    double reached = 0.0, texel_loss = 0.0;
    const int status = published ? kiln_round_judge_published(p, data, &part, unit, &round, &reached, &texel_loss,
                                                              &caustics, &foretold, error)
                                 : judge_target(p, data, &part, unit, &round, error);
    last->unfinished = published ? reached : round.share;
    last->texel_loss = texel_loss;
    last->foretold = foretold;
    last->out_of_time = kiln_round_fit(p, steps, &round);
    choose_caustics(&round, growth_of_caustics(p, &round, &caustics));
    last->round = round;
    const uint64_t more = round.to > 0 ? kiln_round_times(round.to) - kiln_round_times(round.from) : 0;
    for (size_t i = 0; status == KILN_OK && i < data->surface.tile_run_count; i++)
        set_samples(p->settings, data, i, more, kiln_round_units(data->samples[i], more));
    return status;
}
