/* Caustics by light paths that land in texels (worker/pass/land.h): a step whose answers are not gathered tile run by
 * tile run, but sent from the lamps.
 *
 * There are `iterations` of `photons` paths each. Path i is a function of seed and i alone, and of the aims of its
 * iteration. The paths of an iteration are cut into blocks of KILN_LAND_BLOCK, of which each rank traces an equal
 * part; what lands travels to the ranks that have the points, 40 bytes a path at most, is sorted there by point and
 * path, and is summed in that order. After an iteration the aims are corrected: what lands by an aim has a second
 * moment m of its flux, the same for any ranks, as it is summed in integers; a share proportional to the root of m
 * makes the variances of all texels together least (Lagrange's condition). A tenth of the paths stays shared out by the
 * flux that lamps send, so that no aim starves for what has not been found yet.
 *
 *     E(x) = sum over all paths that land in x of flux / (iterations x area of x that is there to be lit)
 *
 * unbiased, for an iteration's aims do not hang on its own paths. The error is that of the sum of independent paths, of
 * which few land in a texel: the root of the sum of their squares. It is an upper estimate, as paths of an aim are
 * spread better than by chance; and unlike the spread of a few iterations it is known well of few.
 *
 * With --caustics vcm gather rays find a part of the light (worker/pass/weighed.h). Landings and rays then weigh by the
 * same number of paths of each aim, so that the shares of the aims stay as they are over all iterations: pilots, four
 * rounds of a quarter of an iteration's paths, teach them before, by what their landings would count, and bring no
 * light. A quarter of the paths is shared out evenly, for what pilots have not found must not starve in all that
 * follow. Who has a point weighs what lands there, by the rays and the area of the point. Then the rays of the batch's
 * tile runs are gathered, and both added; errors add up by their squares.
 *
 * Where the backend of the bake is a device, the host traces the paths and these rays, with Embree and a BVH of its own
 * for the step.
 *
 * After a kill the paths of the step are traced anew: the same, with the same bits. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_H
#define KILN_COORDINATOR_INTEGRATE_LAND_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/save.h"

enum { KILN_LAND_BLOCK = 1 << 20 };

struct kiln_landing;

/* Not collective. All borrowed. KILN_SYSTEM; KILN_USAGE where the user gave fewer photons than there are aims (else
 * more are taken). Destroy with kiln_landing_destroy. */
int kiln_landing_create(struct kiln_landing **landing, const struct kiln_integrate_params *params,
                        struct kiln_solution *solution, const struct kiln_saved *saved, struct kiln_error *error);
void kiln_landing_destroy(struct kiln_landing **landing);

/* Collective. Traces all paths of the step last reported, which gets rays and seconds. Saves and stops when that is
 * asked for. */
int kiln_landing_run(struct kiln_landing *landing, struct kiln_error *error);

/* Gives the answers of a batch of own tile runs to its taker, in place of a backend: a struct kiln_point_result a
 * point. Gathers first where rays have a part. Between kiln_landing_run and the end of the step. */
int kiln_landing_give(struct kiln_landing *landing, const struct kiln_batch *batch, struct kiln_error *error);

#endif
