/* Landings that stay specks however far they are spread, in a step of --caustics vcm whose radius is left to kiln.
 *
 * In the end of spreading (land.h) a point's light may still be one path's: on small parts of bent objects no other
 * point is near that would take some of it. Such light is chance: as bright as the texel is small. A point is noisy
 * whose light E has a variance of more than E^2 / 4, which four equal paths would have. All noisy points of one
 * side of an object, those of texels' other parts too, share their light by their areas: flux stays, and places that no
 * path has met stay dark. Their variance is that of what has landed on them, and what their light varies by beyond
 * chance counts as error, too. Where the light of all of them together is of fewer than two paths it is left out: its
 * power is `unfound` in the energy ledger, and what that would be over the whole side is stated as error.
 *
 * Sums are exact: the same bits for any ranks and cells. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_POOL_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_POOL_H

#include "worker/base/status.h"

struct kiln_landing;

/* Collective, after kiln_merge_spread. Changes landing->merged, and says in the report of the step what is left out.
 * KILN_SYSTEM. */
int kiln_landing_pool(struct kiln_landing *landing, struct kiln_error *error);

#endif
