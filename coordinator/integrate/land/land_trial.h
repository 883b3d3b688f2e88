/* Trial of caustics: decides whether a bake's caustics are worth their noise, if --caustics is left to kiln (auto).
 *
 * Light paths sample caustics one by one: in a scene with few caustics they cost time and leave specks. So the pilots
 * of the first landing step (land.h) measure them. The pilots are two independent halves, whose estimates of a texel's
 * caustics (all light by way of mirrors, gloss and glass) are c1 and c2. With d the texel's direct light, at least a
 * twentieth of the scene's mean, the contribution of caustics is
 *
 *     the greater of  root of (mean of c1 c2 / d^2)   and   mean of (c1 + c2) / 2 d,
 *
 * with means over the area. The product c1 c2 has no bias by noise, and a sharp caustic counts by its texels. Indirect
 * light is not known yet and counts as zero, so the contribution is overestimated rather than underestimated. The error
 * of the remaining light combines that of denoised direct light, a quarter of the stated error, and that of the
 * indirect gather, 0.05 over the root of its rays; it is a quarter of the target error at most. If caustics contribute
 * less than this error, they are left out: neither light paths nor the rays that share with them are traced. Their
 * power then is `unfound` in the energy ledger.
 *
 * With an error of published light (parts/published.h) the contribution is the second mean alone: a few bright spots
 * are not among the 95 % of the texels that are asked about. Caustics are left out below a tenth of that error. With d
 * at least half of the scene's mean a dining room lost caustics that were 15 % of the light of its dark texels.
 *
 * Sums are exact, so all numbers of ranks decide alike. Checkpoints store the decision in the step reports: later parts
 * and resumed bakes follow it. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_TRIAL_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_TRIAL_H

#include "coordinator/integrate/land/land_exchange.h"
#include "coordinator/integrate/step.h"

struct kiln_landing;

/* Not collective. Allocates sums for the pilots, if the step tries caustics; else nothing. KILN_SYSTEM. */
int kiln_land_trial_begin(struct kiln_landing *landing, struct kiln_error *error);
/* Adds the landings of pilots of half 0 or 1. Does nothing without a trial. */
void kiln_land_trial_add(const struct kiln_landing *landing, const struct kiln_landing_list *list, int half);
/* Collective, after the pilots. Writes the result on caustics into the step report. `rounds`: pilot rounds per half.
 * KILN_SYSTEM. */
int kiln_land_trial_end(struct kiln_landing *landing, int rounds, struct kiln_error *error);
/* Whether the current step shall compute no caustics, by the trial in it or in an earlier step. */
bool kiln_land_trial_leaves_out(const struct kiln_landing *landing);

#endif
