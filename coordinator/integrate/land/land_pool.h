/* Pooling of noisy landings: landings that remain bright specks after spreading, in a step of --caustics vcm whose
 * radius kiln chooses.
 *
 * After spreading (land.h) a point's light may still come from one path: on small parts of curved objects no other
 * point is near enough to share it. Such light is noise, and the smaller the texel, the brighter. A point with light E
 * is noisy if its variance exceeds E^2 / 4, the variance of four equal paths. All noisy points of one side of an
 * object, including those of other parts of texels, share their light by area: flux is preserved, and places that no
 * path has hit stay dark. The variance is that of the landings on these points; their differences beyond noise are
 * added as error. If the light of all of them together is of fewer than two paths it is left out: its power is
 * `unfound` in the energy ledger, and its mean over the whole side is stated as error.
 *
 * Sums are exact: the same bits for any ranks and cells. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_POOL_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_POOL_H

#include "worker/base/status.h"

struct kiln_landing;

/* Collective, after kiln_merge_spread. Changes landing->merged, and notes in the report of the step the light left out.
 * KILN_SYSTEM. */
int kiln_landing_pool(struct kiln_landing *landing, struct kiln_error *error);

#endif
