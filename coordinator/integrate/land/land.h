/* Caustics by light paths that land in texels (worker/pass/land.h): a step in which light is traced from the lamps, and
 * not gathered tile run by tile run.
 *
 * A step has a number of iterations of `photons` paths each. Path i depends only on the seed, on i and on the aims of
 * its iteration; no two steps of a bake share a number. The paths of an iteration are cut into batches of
 * KILN_LAND_BATCH; each rank traces an equal part of a block. Landings are sent to the ranks that own the points, at
 * most 32 bytes a path, sorted there by stretches of points, which threads share, and summed in the order of the paths.
 * After an iteration the aims are corrected. The flux that lands by an aim has a second moment m, which is the same for
 * any ranks, since it is summed in integers. Shares of paths proportional to the root of m minimise the sum of the
 * variances of all texels (Lagrange's condition). A tenth of the paths is always distributed by the flux of lamps, so
 * that no aim starves for light that has not been found yet.
 *
 * With --iterations, in a bake with a target error (rounds.h), the steps of a later round have as many times the
 * iterations of the first round's as they have times its samples. So the errors of landed and of gathered light fall
 * alike from round to round, and with --caustics vcm the two share the light as in the first.
 *
 *     E(x) = sum over all paths that land in x of flux / (iterations x area of x that is there to be lit)
 *
 * This is unbiased, since an iteration's aims do not depend on its own paths. The error is that of a sum of independent
 * paths, few of which land in a texel: the root of the sum of their squares. It is an upper estimate, as paths of an
 * aim are better distributed than random ones. Unlike the spread between a few iterations, it is reliable with few of
 * them.
 *
 * With --caustics vcm gather rays find a part of the light (worker/pass/weighed.h). The weights of landings and rays
 * both assume the same number of paths of each aim, so the shares of the aims stay fixed over all iterations. Pilots
 * learn them before: four rounds of a quarter of an iteration's paths, which bring no light, and whose landings count
 * by their weights. A quarter of the paths is distributed evenly, so that light which the pilots have missed does not
 * starve in all that follows. The owner of a point weights its landings, by the rays and the area of the point. Then
 * the rays of all own points are gathered, and both are added; errors add up by their squares.
 *
 * In the end the landings of all iterations, and the light of the rays with them, are spread over nearby points, as far
 * as suits each place (merge.h: kiln_merge_fit), at most six texels or --merge-radius. The light that rays find at a
 * point counts as one more landing, with the flux that makes this light; its square is the variance of the rays' mean.
 * With --merge-radius `texel`, rays are gathered batch by batch, when results are given. In any case landings and rays
 * are weighted with the area of the landing's own texel: the weights of a path add up to 1 by this alone, and spreading
 * moves light that has been weighted, so flux is preserved. Weights by the area over which light is spread, learnt from
 * the pilots, were tried: in a dining room the errors did not change.
 *
 * With --caustics vcm flat mirrors show lamps without extent by their images (worker/backend/mirror_images.h), and
 * landings by such a reflection alone are dropped.
 *
 * Paths that a device does not support (kiln_backend_takes) are traced by the host, with Embree and a separate BVH for
 * the step; the run report lists them.
 *
 * With --caustics merge the landings of an iteration are spread over nearby points (merge.h).
 *
 * A checkpoint has the sums, the moments and the learnt shares, up to the end of a block. After a kill the paths of the
 * interrupted block are traced again, with the same bits. Rays whose light is spread are all gathered again. They are
 * counted when results are given, and so only once. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/run/save.h"

enum { KILN_LAND_BATCH = 1 << 22 };

struct kiln_landing;

/* Number of paths in an iteration: the number asked for; if the user gave none, at least four an aim. */
uint64_t kiln_landing_photons(const struct kiln_integrate_settings *settings, size_t aims);
/* Number of gather rays of a point that share its light with paths: a fourth of `samples`, since paths find most of the
 * light. All `samples` if rays find lamps through images in mirrors, if `samples` is small, or if rounds add to them.
 */
uint32_t kiln_landing_rays(const struct kiln_integrate_settings *settings, uint32_t samples, bool images);
/* Maximum number of aims up to which objects are cut into several targets (kiln_aims_create). */
size_t kiln_landing_aims(const struct kiln_integrate_settings *settings);
/* Creates the backend for paths that the device leaves to the host (kiln_backend_takes): Embree, with the same scene
 * and surface. NULL if the bake itself uses Embree. KILN_SYSTEM. Destroy with kiln_backend_destroy, in any case. */
int kiln_landing_host(struct kiln_backend **host, struct kiln_backend *bake, struct kiln_error *error);
/* Whether landings, and light of the gather rays that share it, are spread over nearby points in the end. */
bool kiln_landing_spreads(const struct kiln_integrate_settings *settings);
/* Additional bytes of each point in a checkpoint within the step. */
uint64_t kiln_landing_saved_bytes(enum kiln_caustics caustics);
/* Additional bytes that a rank with `points` points needs while paths land. `landed`: fraction of the paths that land
 * beside points. */
uint64_t kiln_landing_bytes(const struct kiln_integrate_settings *settings, size_t aims, double points, uint32_t ranks,
                            double landed);

/* Creates the state of the step. Not collective. All arguments are borrowed. KILN_SYSTEM; KILN_USAGE if the user gave
 * fewer photons than there are aims (without a given number, more are taken). Destroy with kiln_landing_destroy. */
int kiln_landing_create(struct kiln_landing **landing, const struct kiln_integrate_params *params,
                        struct kiln_solution *solution, const struct kiln_saved *saved, struct kiln_error *error);
void kiln_landing_destroy(struct kiln_landing **landing);

/* Collective. Traces all paths of the step last reported that the open checkpoint does not have, and adds rays and
 * seconds to its report. Also gathers the rays whose light is spread. Saves and stops when asked to. */
int kiln_landing_run(struct kiln_landing *landing, struct kiln_error *error);

/* Fills in the blocks of a checkpoint within the step, which borrow, and returns their number. There are none outside a
 * landing step, and none during pilots, which a resumed bake traces again. */
enum { KILN_LANDING_ARRAYS = 6 };
size_t kiln_landing_arrays(struct kiln_landing *landing, struct kiln_array_range blocks[KILN_LANDING_ARRAYS]);

/* The step is over: frees what it needed. */
void kiln_landing_end(struct kiln_landing *landing);

/* Other points are this rank's now: forgets what is kept of them from step to step. */
void kiln_landing_points_moved(struct kiln_landing *landing);

/* Gives the results of a batch of own tile runs to the batch's `take`, in place of a backend: a struct
 * kiln_point_result a point. Receiver-only objects, which no path hits, gather their light (worker/pass/caustic.h).
 * With --caustics vcm rays gather a part first, on the host, unless kiln_landing_run has done so. Call it between
 * kiln_landing_run and the end of the step. Returns the status of `take` or of the backend. */
int kiln_landing_give(struct kiln_landing *landing, const struct kiln_batch *batch, struct kiln_error *error);

#endif
