/* Whether a bake's caustics are worth their noise, where --caustics leaves that to kiln (auto).
 *
 * Paths that land find what a lamp sends by way of gloss one by one: a scene with little such light pays for its noise
 * in time, and sees it as specks. So the pilots of the first step that lands (land.h) look first. Each of two halves of
 * them, independent of each other, finds of the light of a texel c1 and c2, all that comes by mirrors, gloss and glass.
 * With d the texel's direct light, at least a twentieth of the scene's mean, caustics bring
 *
 *     the greater of  root of (mean of c1 c2 / d^2)   and   mean of (c1 + c2) / 2 d,
 *
 * means being over the area: the product has no noise of its own in the mean, and a sharp caustic counts by its texels.
 * Indirect light is not known yet and counts nothing, so that the share is too large rather than too small. The error
 * of the rest is about that of direct light once it is denoised, a quarter of what was stated, and what the gather of
 * indirect light leaves of its own, 0.05 over the root of its rays; but a quarter of the target error at most. Where
 * caustics bring less than that error, they are left out: no more paths, and no rays that share with them.
 * What they are is `unfound` in the energy ledger then.
 *
 * Sums are exact, so the answer is the same for any ranks, and it lies in checkpoints with the reports of the steps:
 * later parts of a bake, and a bake that goes on, do as the first step did. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_TRIAL_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_TRIAL_H

#include "coordinator/integrate/land/land_exchange.h"
#include "coordinator/integrate/step.h"

struct kiln_landing;

/* Not collective. Room for what pilots find, if the step tries caustics; else nothing. KILN_SYSTEM. */
int kiln_land_trial_begin(struct kiln_landing *landing, struct kiln_error *error);
/* Adds landings of a pilot of the half 0 or 1. Nothing where nothing is tried. */
void kiln_land_trial_add(const struct kiln_landing *landing, const struct kiln_landing_list *list, int half);
/* Collective, after the pilots: fills in what the report of the step says of caustics. `rounds`: pilots of a half.
 * KILN_SYSTEM. */
int kiln_land_trial_end(struct kiln_landing *landing, int rounds, struct kiln_error *error);
/* Whether the step that is under way is to bring nothing, as it or one before it has found. */
bool kiln_land_trial_leaves_out(const struct kiln_landing *landing);

#endif
