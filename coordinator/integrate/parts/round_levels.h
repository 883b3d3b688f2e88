/* Levels of samples in rounds (rounds.h), and the level that a round for an error of published light goes to. Pure. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_ROUND_LEVELS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_ROUND_LEVELS_H

#include "coordinator/integrate/parts/published.h"

#define KILN_ROUND_JUDGED_WITHIN 4.0  /* raw error over the error asked for, above which light is not denoised */
#define KILN_ROUND_DENOISED_USUAL 0.5 /* error of denoised light over that of raw light there */

enum {
    KILN_ROUND_LEVELS_MOST = 6,       /* most levels per round: few samples give an unreliable error */
    KILN_ROUND_SAMPLES_MOST = 1 << 18 /* of a step of one part */
};

/* Twice the samples up to a level, relative to those of the first round. */
uint64_t kiln_round_times(uint32_t level);

/* The most samples that a part of the first round has in a step. */
uint64_t kiln_round_most_first(const struct kiln_integrate_settings *settings);

/* Units that a tile run takes of a round of `more` halves of the samples of the first round, of which it needs `need`:
 * all, or the half, quarter or eighth that is enough, since such beginnings of a Sobol' sequence are well spread. */
uint32_t kiln_round_units(uint32_t need, uint64_t more);

/* Returns the samples of a step in a part of the first round, given `samples` of the settings. If the step counts for
 * the result: a quarter of a part's share, even, at least 2. If only other steps gather from it: at least one. */
uint32_t kiln_round_first(uint32_t samples, bool counts);

/* The standard error with which a tile run is finished. */
double kiln_round_standard(const struct kiln_integrate_settings *settings);
/* Samples that a tile run needs beyond those it has had, both in halves of those of the first round. `square`: its
 * variance over the allowed one, of which caustics, which have samples of their own, have a share. */
uint32_t kiln_round_need(double had, double square, double caustics);
/* Sets round->to to the least level at which the error is expected to be small enough; leaves it where no level has
 * more samples than texels may have. */
void kiln_round_choose_published(const struct kiln_integrate_settings *settings, const struct kiln_published *published,
                                 struct kiln_round *round);

#endif
