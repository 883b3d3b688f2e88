/* Caustics by light paths that land in texels (worker/pass/land.h): a step whose answers are not gathered tile run by
 * tile run, but sent from the lamps.
 *
 * A step has so many iterations of `photons` paths each. Path i is a function of seed and i alone, and of the aims of
 * its iteration; no two steps of a bake share a number. The paths of an iteration are cut into blocks of
 * KILN_LAND_BLOCK, of which each rank traces an equal part; what lands travels to the ranks that have the points, 32
 * bytes a path at most, is sorted there by stretches of points, which threads share, and is summed in the order of the
 * paths. After an iteration the aims are corrected: what lands by an aim has a second moment m of its flux, the same
 * for any ranks, as it is summed in integers; a share proportional to the root of m makes the variances of all texels
 * together least (Lagrange's condition). A tenth of the paths stays shared out by the flux that lamps send, so that no
 * aim starves for what has not been found yet.
 *
 * With --iterations all the steps of later rounds of a bake with a target error (rounds.h) have as many times the
 * iterations of the first round's as they have times its samples: the error of what lands falls from round to round as
 * that of what is gathered does, and with --caustics vcm the two share the light as in the first.
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
 * follow. Who has a point weighs what lands there, by the rays and the area of the point. Then the rays of all own
 * points are gathered, and both added; errors add up by their squares.
 *
 * In the end what has landed in all iterations, and with it what rays have found, is spread over the points nearby, as
 * far as it suits each place (merge.h: kiln_merge_fit), at most six texels or --merge-radius. What rays find at a point
 * is one landing more of the flux that makes it, whose square is the variance of their mean. Where --merge-radius is
 * `texel` rays are gathered batch by batch, when answers are given. A landing weighs by the area of its own texel all
 * the same, on both sides: that the weights of a path add up to 1 hangs on nothing else, and spreading moves light that
 * has been weighed, so flux stays. Weights by the area that light is spread over, learnt from the pilots, were tried:
 * in a dining room errors stayed as they are.
 *
 * With --caustics vcm flat mirrors show lamps without extent by their images (worker/backend/mirror_images.h), and what
 * lands by such a reflection alone is dropped.
 *
 * What a device does not take of this (kiln_backend_takes) the host traces, with Embree and a BVH of its own for the
 * step; the run report says what.
 *
 * With --caustics merge what lands in an iteration is spread over the points nearby (merge.h).
 *
 * A checkpoint has the sums, the moments and what was learnt, up to the end of a block. After a kill the paths of the
 * block that was under way are traced anew: the same, with the same bits. Rays that are spread are gathered anew, all
 * of them. They count when answers are given, and so once. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/run/save.h"

enum { KILN_LAND_BLOCK = 1 << 22 };

struct kiln_landing;

/* The paths of an iteration: those asked for; where the user did not say how many, four an aim at least. */
uint64_t kiln_landing_photons(const struct kiln_integrate_settings *settings, size_t aims);
/* Rays of a point that share its light with paths, which find most of it: a fourth of the samples of a gather. As many
 * where their places show images of lamps in mirrors, where there are few, and where rounds add to them. */
uint32_t kiln_landing_rays(const struct kiln_integrate_settings *settings, uint32_t samples, bool images);
/* The aims up to which objects are cut into several targets (kiln_aims_create). */
size_t kiln_landing_aims(const struct kiln_integrate_settings *settings);
/* Creates the backend for all that a device leaves to the host (kiln_backend_takes): Embree, with the same scene and
 * surface. NULL beside Embree. KILN_SYSTEM. Destroy with kiln_backend_destroy, in any case. */
int kiln_landing_host(struct kiln_backend **host, struct kiln_backend *bake, struct kiln_error *error);
/* Whether landings and the gather rays that share the light are spread over points nearby in the end. */
bool kiln_landing_spreads(const struct kiln_integrate_settings *settings);
/* Bytes of each point in a checkpoint within the step, more than in others. */
uint64_t kiln_landing_saved_bytes(enum kiln_caustics caustics);
/* Bytes that a rank with so many points needs while paths land, besides that. `landed`: share of the paths that land
 * beside points. */
uint64_t kiln_landing_bytes(const struct kiln_integrate_settings *settings, size_t aims, double points, uint32_t ranks,
                            double landed);

/* Not collective. All borrowed. KILN_SYSTEM; KILN_USAGE where the user gave fewer photons than there are aims (else
 * more are taken). Destroy with kiln_landing_destroy. */
int kiln_landing_create(struct kiln_landing **landing, const struct kiln_integrate_params *params,
                        struct kiln_solution *solution, const struct kiln_saved *saved, struct kiln_error *error);
void kiln_landing_destroy(struct kiln_landing **landing);

/* Collective. Traces all paths of the step last reported, which gets rays and seconds; those that the open
 * checkpoint does not have. And gathers what is spread with them. Saves and stops when that is asked for. */
int kiln_landing_run(struct kiln_landing *landing, struct kiln_error *error);

/* Fills in the blocks of a checkpoint within the step, which borrow, and returns how many. None outside of a step that
 * lands, and none while pilots are traced, which a bake that goes on traces again. */
enum { KILN_LANDING_BLOCKS = 6 };
size_t kiln_landing_blocks(struct kiln_landing *landing, struct kiln_block blocks[KILN_LANDING_BLOCKS]);

/* The step is over: frees what it needed. */
void kiln_landing_end(struct kiln_landing *landing);

/* Gives the answers of a batch of own tile runs to its taker, in place of a backend: a struct kiln_point_result a
 * point. Receiver-only objects, which no path meets, gather theirs (worker/pass/caustic.h); with --caustics vcm rays
 * gather a part first, on the host, where kiln_landing_run has not done so. Between kiln_landing_run and the end of the
 * step. The status of `take` or of the backend. */
int kiln_landing_give(struct kiln_landing *landing, const struct kiln_batch *batch, struct kiln_error *error);

#endif
