/* Late bounces only where they matter, in the lean schedule without a number of bounces. White walls that enclose a
 * little light keep it for long, and the bounces do not end before that is known; most of the scene has nothing to
 * gain from them.
 *
 * A late bounce computes the tiles alone where much is left. What is left of a point is q / (1 - q) times its
 * radiosity of the last bounce, where q is the ratio of a bounce's power to the one before (struct kiln_tail_fit; the
 * greater one of the last ratio and the fit's). A tile ends when what is left, over what the point has had so far, is
 * KILN_LATE_LEFT at most, in the mean over its points and over those of each of its eight neighbours in the lightmap:
 * the answers of few samples in one tile alone may lie. It gets what is left of its points, by that very estimate, and
 * is computed and sends no more. A point with albedo that no light has reached yet keeps its tile going.
 *
 * What others miss for it is at most KILN_LATE_LEFT of what they have from the tile, or less than that of all their
 * light: what points gather is a sum of what others send, none of it negative. kiln_integrate_report.tail_error counts
 * it. The final gather reads what all have, with what was left. */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_LATE_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_LATE_H

#include "coordinator/integrate/integrator.h"

#define KILN_LATE_LEFT 5e-4
#define KILN_LATE_DARK 1e-4   /* of the mean radiosity: what a point has had is never taken to be less */
enum { KILN_LATE_FIRST = 9 }; /* the number of the first late bounce: most scenes settle before it */

/* Whether a step is a late bounce. */
static inline bool kiln_late_is(const struct kiln_step *step)
{
    return step->pass->reads_radiosity && !step->terminal && step->samples_field != NULL;
}

/* Before the first step of a bake or part: no own tile has ended. Nothing where the number of bounces is given. */
void kiln_late_reset(const struct kiln_rank_data *own);

/* Collective, before a late bounce with so many samples, while `next` is what the step before it has found. Fills in
 * the field of its samples: 0 for tiles that have ended. The same for any ranks and cells. KILN_SYSTEM. */
int kiln_late_choose(const struct kiln_integration *integration, uint32_t samples, struct kiln_error *error);

/* Once `next` has been exchanged: what the bounce does not compute sends nothing. */
void kiln_late_clear(const struct kiln_rank_data *own);

#endif
