/* Restriction of late bounces to the tiles that need them, in the lean schedule without a given number of bounces. A
 * little light enclosed by white walls stays there for long, and the bounces go on until it is resolved; most of the
 * scene gains nothing from them.
 *
 * A late bounce computes only tiles with much remaining light. A point's remaining light is estimated as q / (1 - q)
 * times its radiosity of the last bounce; q is the ratio of the powers of successive bounces (struct kiln_tail_fit; the
 * larger of the last ratio and the fitted one). A tile ends when the remaining light, relative to the point's light so
 * far, is at most KILN_LATE_LEFT in the mean over its points and over those of each of its eight neighbours in the
 * lightmap; results of few samples in a single tile may mislead. The estimated remaining light is then added to its
 * points, and the tile is no longer computed and sends no more radiosity. A tile continues while a point with albedo
 * has not received light yet.
 *
 * Other points lose by this at most KILN_LATE_LEFT of the light that they have from the tile, and no more of all their
 * light: a gather is a sum of non-negative contributions. kiln_integrate_report.tail_error includes this loss. The
 * final gather reads the light of all points, including the added remainder. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_LATE_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_LATE_H

#include "coordinator/integrate/integrator.h"

#define KILN_LATE_LEFT 5e-4
#define KILN_LATE_DARK 1e-4   /* of the mean radiosity: lower bound for the light of a point so far */
enum { KILN_LATE_FIRST = 9 }; /* number of the first late bounce: most scenes converge before it */

/* Whether a step is a late bounce. */
static inline bool kiln_late_is(const struct kiln_step *step)
{
    return step->pass->reads_radiosity && !step->terminal && step->samples_field != NULL;
}

/* Marks all own tiles as not ended, before the first step of a bake or part. Does nothing if the number of bounces is
 * given. */
void kiln_late_reset(const struct kiln_rank_data *own);

/* Collective, before a late bounce with `samples` samples, while `next` has the result of the step before. Fills in the
 * field of samples of the bounce: 0 for tiles that have ended. The same for any ranks and cells. KILN_SYSTEM. */
int kiln_late_choose(const struct kiln_integration *integration, uint32_t samples, struct kiln_error *error);

/* Clears `next` once it has been exchanged, so that points which the bounce does not compute send nothing. */
void kiln_late_clear(const struct kiln_rank_data *own);

#endif
