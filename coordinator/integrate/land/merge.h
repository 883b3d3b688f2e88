/* Merging: light that lands near a surface point counts for it too (--caustics merge, vcm), so that few paths make a
 * smooth caustic, at the price of a blurred one.
 *
 * The flux landed in a texel is treated as lying at the texel's place x_p, since it has no finer resolution. Merging
 * spreads this flux over the points near it. With phi_p the flux landed at point p, a_q the area of point q that can be
 * lit, and N(q) the points near q, including q,
 *
 *     E(q) = sum over p in N(q) of K(p, q) phi_p,     K(p, q) = s_p s_q / max(c_p, c_q),     c_p = s_p sum of a_q s_q
 *
 * The fraction of phi_q that K does not spread, 1 - sum of a_p K(p, q), stays at q. The weights a_q K(p, q) thus add up
 * to 1, so flux is conserved and the energy ledger closes. K is symmetric, so the sum of a_p K(p, q) is 1 as well:
 * uniform light stays uniform up to edges and corners, which a division by pi r^2 would darken. The factor s makes c
 * nearly 1, so that little stays: first s = 1 / root of A(p), with A(p) the area of N(p), then s / root of c
 * (Sinkhorn's balancing of a symmetric matrix; the maximum makes it exact, like the acceptance in the
 * Metropolis-Hastings algorithm).
 *
 * Points p and q are near each other if |x_q - x_p| <= r, their normals are within 60 degrees, and each lies at most r
 * / 4 from the plane of the other: also across charts and objects, and through a wall that stands on the plane.
 * Iteration i = 0, 1, ... of the paths has the radius
 *
 *     r(i) = r(0) n^((alpha - 1) / 2), n the largest power of 2 up to i + 1
 *
 * Iterations with one radius, which are one more than all before them, are spread together (after Knaus and Zwicker,
 * "Progressive Photon Mapping: A Probabilistic Approach", 2011: their squared radius is a product of (k + alpha) / (k +
 * 1), here replaced by its power law, in steps). E is the mean over the iterations. Its error is that of the sum of
 * independent paths, plus the bias. Spreading with half the radius reveals the bias: radius r has the bias c r^2 and r
 * / 2 a quarter of it, so the difference is three quarters. The random part of the difference is known path by path and
 * is subtracted.
 *
 * Light that lands is sparse: a step may find caustics at a hundredth of the points. So sums are over those points
 * alone that the light comes to, or whose weights those of such points depend on. Points that stand together are
 * searched for together (merge_group.h).
 *
 * Points of other ranks: once the radius is known, each rank receives those within the radius of boxes about its own
 * points (40 bytes each), and for each spreading their landed flux (32 bytes each). Sums are ordered by place, lightmap
 * and texel: the same bits for any ranks, threads and cells. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_MERGE_H
#define KILN_COORDINATOR_INTEGRATE_LAND_MERGE_H

#include <mpi.h>

#include "coordinator/integrate/land/land_exchange.h"
#include "worker/backend/backend.h"

/* Sums over all iterations so far at an own point; W/m2, not yet divided by the number of iterations. Stored in
 * checkpoints. */
struct kiln_merged {
    double irradiance[3], incident[3];
    double square;   /* sum of squares: luminance of irradiance by single paths */
    double half;     /* luminance of irradiance, spread with half the radius */
    double variance; /* of the difference between the two radii */
};

struct kiln_merge;
struct kiln_merge_place;

struct kiln_merge_params {
    MPI_Comm communicator;
    const struct kiln_backend_params *world; /* borrowed, as what follows */
    const struct kiln_surface *surface;      /* with this rank's points */
    const float *lit;                        /* m2, own points: area that can be lit; 0: the point takes no part */
    /* m, for each lightmap, equal on all ranks: farthest that light of its points is spread; NULL: the radius alone
     * limits it */
    const float *widest;
    const struct kiln_merge_place *places; /* of own points: kiln_merge_find_places */
    uint32_t threads;
    uint64_t limit; /* of a message (mpi/exchange.h) */
};

/* Not collective. Finds the places of this rank's points, of which those that take part have one. Needs all parameters
 * but `places`. The caller frees them. KILN_SYSTEM. */
int kiln_merge_find_places(const struct kiln_merge_params *params, struct kiln_merge_place **places,
                           struct kiln_error *error);

/* Collective. Creates a merge without a radius. KILN_SYSTEM. Copies what it needs, but for the places. Destroy with
 * kiln_merge_destroy, which is not collective. */
int kiln_merge_create(struct kiln_merge **merge, const struct kiln_merge_params *params, struct kiln_error *error);
void kiln_merge_destroy(struct kiln_merge **merge);

/* Collective. Sets the largest radius that will be used, m, and receives the points of other ranks within it. With 0 or
 * less each point keeps its own light. If the radius was set before, points and grid are kept. KILN_SYSTEM. */
int kiln_merge_set_radius(struct kiln_merge *merge, double radius, struct kiln_error *error);
/* Not collective. Frees what is of no use until a radius is set again. */
void kiln_merge_rest(struct kiln_merge *merge);

/* Collective. Spreads `landed`, the light of own points from iterations of one radius, over the points within `radius`,
 * m, which is at most the radius set. Adds the result to `merged`, for own points. KILN_SYSTEM. */
int kiln_merge_spread(struct kiln_merge *merge, const struct kiln_landing_sum *landed, double radius,
                      struct kiln_merged *merged, struct kiln_error *error);

/* Collective. Fits a radius to each point from `landed`, the light of own points from all iterations. The search goes
 * from the point alone to the radius set, in ten steps. The result is the widest radius whose light E = sum of phi /
 * sum of a agrees with that of all narrower ones within noise (after Lepski: they differ by at most 1.5 times the sum
 * of their standard errors; the narrower one's error is at least the expectation from the wider one's squares, so that
 * a spot without landings by chance is no edge). Alternatively it is the narrowest radius with as many as `landings` of
 * equal flux, (sum of phi)^2 / sum of phi^2. Two points then are near each other within the smaller of their radii: a
 * caustic with a narrow radius keeps its edge and the dark beside it, while isolated landings are spread far. Spreading
 * uses these radii until another is set. `averaged`: number of such results that are averaged. What is blurred is so in
 * each of them, while noise averages out: standard errors and `landings` are those of the average. KILN_SYSTEM. */
int kiln_merge_fit(struct kiln_merge *merge, const struct kiln_landing_sum *landed, double landings, double averaged,
                   struct kiln_error *error);

/* Input of the search for a radius. */
struct kiln_merge_search {
    const struct kiln_landing_sum *landed; /* landings of the first iteration at own points */
    struct kiln_merged *merged;            /* scratch sums of own points; zero afterwards */
    uint64_t iterations;
    double alpha;
    double texel; /* m, mean width; texel and scale are the same on all ranks */
    double scale; /* (W/m2)2 m2: scale of the sums of squares */
};

/* Collective. Finds an initial radius, m, if the user gave none: the one with the least squared error over the scene.
 * The variance of all iterations is taken as that of the first over their number, the bias as measured in the first.
 * Sums over all points are reliable even if single points have few landings. The radii tried start at 1.5 texels and
 * grow by the root of 2, until two are worse than the best; 0 if none is better than separate texels. Later radii are
 * smaller, so the result is divided by the mean of r(i) / r(0). The radius set afterwards is of no use. KILN_SYSTEM. */
int kiln_merge_find_radius(struct kiln_merge *merge, const struct kiln_merge_search *search, double *radius,
                           struct kiln_error *error);

/* Returns r(i), m; kiln_merge_radius_ends: whether the next iteration has another radius. */
double kiln_merge_radius_of(double first, double alpha, uint64_t iteration);
static inline bool kiln_merge_radius_ends(uint64_t iteration) { return ((iteration + 2) & (iteration + 1)) == 0; }

/* Returns the standard error of the mean over `iterations`, bias included; W/m2. */
double kiln_merge_error(const struct kiln_merged *merged, uint64_t iterations);

/* Most bytes of lists of what is near points, an own point, so that later searches are saved. */
enum { KILN_MERGE_LISTED_BYTES = 128 };
/* Approximate bytes that a rank needs per own point, besides struct kiln_merged: places twice, fluxes, weights twice,
 * the grid, marks, lists; what makes the grid is less than the lists. Points of other ranks need as much each, but are
 * few. */
enum { KILN_MERGE_POINT_BYTES = 2 * 40 + 32 + 2 * 16 + 24 + 2 + KILN_MERGE_LISTED_BYTES };
/* Number of searches for the points near each point: for one radius, for finding the initial radius, and for fitting
 * each point's own radius. A search costs about as much as several passes that spread. */
enum { KILN_MERGE_PASSES = 4, KILN_MERGE_SEARCH_PASSES = 12, KILN_MERGE_FIT_PASSES = 8 };

#endif
