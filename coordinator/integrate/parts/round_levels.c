#include "coordinator/integrate/parts/round_levels.h"

#include <math.h>

enum {
    FIRST = 4 * KILN_PARTS, /* samples of the settings over those of a part in the first round */
    MOST_HALVED = 3,        /* a tile run takes an eighth of a round at least */
    LEVELS_MOST = 2,        /* most levels of a round: its gathers read light that the round before has found */
    SAMPLES_MOST = 1 << 15  /* of a step of a part, without --time */
};
#define OF_PUBLISHED 0.5 /* standard error over a target that 95.45 % of normal errors stay below */
#define AIM 0.93         /* error that a round aims at, over the error asked for: else many would miss it by little */
/* tile runs are finished at this fraction of what is allowed: finer light gains less from denoising */
#define FINISHED 0.8
#define OWN_LEAST 0.5 /* of the variance that is allowed: what caustics leave for other light */

uint32_t kiln_round_first(uint32_t samples, bool counts)
{
    const uint32_t share = samples / FIRST + (samples % FIRST > 0);
    return counts ? share + (share & 1u) : share;
}

uint64_t kiln_round_times(uint32_t level) { return (level % 2 > 0 ? 3ull : 2ull) << level / 2; }

uint32_t kiln_round_units(uint32_t need, uint64_t more)
{
    uint64_t units = more;
    for (int halved = 0; halved < MOST_HALVED && (units + 1) / 2 >= need; halved++)
        units = (units + 1) / 2;
    return need > 0 ? (uint32_t)units : 0;
}

uint64_t kiln_round_most_first(const struct kiln_integrate_settings *settings)
{
    const uint32_t direct = kiln_round_first(settings->samples_direct, true),
                   final = kiln_round_first(settings->samples_indirect, true);
    const uint64_t bounce = 4 * (uint64_t)kiln_round_first(settings->samples_bounce, false);
    const uint64_t counted = direct > final ? direct : final;
    return counted > bounce ? counted : bounce;
}

double kiln_round_standard(const struct kiln_integrate_settings *settings)
{
    return OF_PUBLISHED * FINISHED * settings->published_error;
}

uint32_t kiln_round_need(double had, double square, double caustics)
{
    const double own = square * (1.0 - caustics), allowed = fmax(1.0 - square * caustics, OWN_LEAST),
                 need = ceil(had * (own / allowed - 1.0));
    return own > allowed ? (uint32_t)fmin(fmax(need, 1.0), 0x1p31) : 0;
}

void kiln_round_choose_published(const struct kiln_integrate_settings *settings, const struct kiln_published *published,
                                 struct kiln_round *round)
{
    const uint64_t first = kiln_round_most_first(settings),
                   most = settings->time > 0.0 ? KILN_ROUND_SAMPLES_MOST : SAMPLES_MOST;
    const uint32_t now = round->from;
    for (uint32_t l = now + 1; l < KILN_ROUND_LEVELS && l <= now + LEVELS_MOST; l++) {
        const double times = (double)kiln_round_times(l) / (double)kiln_round_times(now);
        if (first / 2 * kiln_round_times(l) > most)
            break;
        round->to = l;
        if (kiln_published_expected(published, times, kiln_round_standard(settings), AIM * settings->published_error) <=
            1.0 - KILN_PUBLISHED_SHARE)
            break;
    }
}
