/* Merging: light that lands near a surface point counts for it too (--caustics merge, vcm), so that few paths make a
 * smooth caustic, at the price of a blurred one.
 *
 * What has landed in a texel is taken to lie at its place x_p, of which the texel is the resolution. It is spread over
 * the points near it. With phi_p the flux that landed at point p, a_q the area of point q that is there to be lit, and
 * N(q) the points near q, among them q itself,
 *
 *     E(q) = sum over p in N(q) of K(p, q) phi_p,     K(p, q) = s_p s_q / max(c_p, c_q),     c_p = s_p sum of a_q s_q
 *
 * and what K leaves over of phi_q, 1 - sum of a_p K(p, q) of it, stays at q. So the sum of a_q K(p, q) is 1: flux is
 * conserved, and the energy ledger closes. And as K is symmetric the sum of a_p K(p, q) is 1, too: light that lies
 * evenly stays even, up to edges and corners, which a division by pi r^2 would darken. s is what makes c nearly 1, so
 * that little is left over: s = 1 / root of A(p), the area of N(p), then s / root of c (Sinkhorn's balancing of a
 * symmetric matrix; the maximum makes it exact, as the acceptance of Metropolis and Hastings does).
 *
 * Points p and q are near each other where |x_q - x_p| <= r, their normals are within 60 degrees, and each lies at most
 * r / 4 from the plane of the other: also across charts and objects, and through a wall that stands on the plane. In
 * iteration i = 0, 1, ... of the paths
 *
 *     r(i) = r(0) n^((alpha - 1) / 2), n the largest power of 2 up to i + 1
 *
 * so that iterations with one radius, which are as many as all before them and one, are spread together
 * (after Knaus and Zwicker, "Progressive Photon Mapping: A Probabilistic Approach", 2011, where the radius squared
 * falls as the product of (k + alpha) / (k + 1), here by its power law and in steps). E is the mean over the
 * iterations. Its error is that of the sum of independent paths, and the bias. That shows where half the radius gives
 * something else: the bias of r is c r^2, so that of r / 2 is a quarter of it, and their difference three quarters.
 * What the difference has by chance is known, path by path, and is taken off.
 *
 * Points of other ranks: when the radius is known each rank gets those within it of boxes about its own points (40
 * bytes each), and for each spreading what landed there (32 bytes each). Sums go by place, lightmap and texel: the same
 * bits for any ranks, threads and cells. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_MERGE_H
#define KILN_COORDINATOR_INTEGRATE_LAND_MERGE_H

#include <mpi.h>

#include "coordinator/integrate/land/land_exchange.h"
#include "worker/backend/backend.h"

/* Sums over all iterations so far at an own point; W/m2, not yet divided by the number of iterations. Lies in
 * checkpoints. */
struct kiln_merged {
    double irradiance[3], incident[3];
    double square;   /* of the luminances of irradiance that single paths bring */
    double half;     /* luminance of irradiance, by half the radius */
    double variance; /* of what that differs by */
};

struct kiln_merge;

struct kiln_merge_params {
    MPI_Comm communicator;
    const struct kiln_backend_params *world; /* borrowed, as what follows */
    const struct kiln_surface *surface;      /* with this rank's points */
    const float *lit;                        /* m2, an own point: area that is there to be lit; 0: it takes no part */
    /* m, a lightmap: how far light of its points is spread at most, alike on all ranks; NULL: as far as the radius */
    const float *widest;
    uint32_t threads;
    uint64_t limit; /* of a message (mpi/exchange.h) */
};

/* Collective. Has no radius yet. KILN_SYSTEM. Copies what it needs. Destroy with kiln_merge_destroy, which is not
 * collective. */
int kiln_merge_create(struct kiln_merge **merge, const struct kiln_merge_params *params, struct kiln_error *error);
void kiln_merge_destroy(struct kiln_merge **merge);

/* Collective. Gets the points of other ranks within the radius, m, the largest that comes; 0 or less: each point keeps
 * what is its own. KILN_SYSTEM. */
int kiln_merge_set_radius(struct kiln_merge *merge, double radius, struct kiln_error *error);

/* Collective. Spreads what landed in iterations of one radius (`landed`: of own points) over the points within
 * `radius`, m, which is at most the one set, and adds that to `merged` (likewise). KILN_SYSTEM. */
int kiln_merge_spread(struct kiln_merge *merge, const struct kiln_landing_sum *landed, double radius,
                      struct kiln_merged *merged, struct kiln_error *error);

/* Collective. Gives each point a radius of its own, by what has landed in all iterations (`landed`: of own points):
 * the widest whose light E = sum of phi / sum of a agrees with that of all narrower ones, as far as chance lets it
 * (after Lepski: the two are 1.5 times the sum of their standard errors apart at most; the error within the narrower
 * one is at least what the squares within the wider let expect, so that where nothing has landed by chance is no edge);
 * or the narrowest within which there are as many as `landings` of equal flux, (sum of phi)^2 / sum of phi^2. From the
 * point alone to the radius set in ten steps. Two points are near each other, then, where they are by the smaller of
 * both: a caustic with a narrow radius keeps its edge, and the dark beside it nothing of it, while what lands alone is
 * spread far. Spreading goes by these until another radius is set. KILN_SYSTEM. */
int kiln_merge_fit(struct kiln_merge *merge, const struct kiln_landing_sum *landed, double landings,
                   struct kiln_error *error);

/* Input of the search for a radius. */
struct kiln_merge_search {
    const struct kiln_landing_sum *landed; /* in the first iteration, of own points */
    struct kiln_merged *merged;            /* likewise, to work with; zero afterwards */
    uint64_t iterations;
    double alpha;
    double texel; /* m, mean width; this and the next are the same on all ranks */
    double scale; /* (W/m2)2 m2, of sums of squares */
};

/* Collective. The radius at first where none was given, m: the one with the least square of the error over the scene,
 * when the variance of all iterations is that of the first over their number, and the bias is as the first shows it.
 * Such sums over all points are known well even where a point has few landings. Radii from 1.5 texels on are tried,
 * each longer by the root of 2 than the one before, until two are worse than the best; 0, where none is better than
 * texels apart. As later radii are smaller, it is divided by the mean of r(i) / r(0). No radius is set afterwards that
 * is of use. KILN_SYSTEM. */
int kiln_merge_find_radius(struct kiln_merge *merge, const struct kiln_merge_search *search, double *radius,
                           struct kiln_error *error);

/* r(i), m; and whether the iteration after it has another. */
double kiln_merge_radius_of(double first, double alpha, uint64_t iteration);
static inline bool kiln_merge_radius_ends(uint64_t iteration) { return ((iteration + 2) & (iteration + 1)) == 0; }

/* The standard error of the mean over `iterations`, bias included; W/m2. */
double kiln_merge_error(const struct kiln_merged *merged, uint64_t iterations);

/* About, bytes that a rank needs of each of its points, besides struct kiln_merged: places twice, fluxes, weights
 * twice, the grid, and what it is made with. Points of others count likewise, and are few. */
enum { KILN_MERGE_POINT_BYTES = 2 * 40 + 32 + 2 * 16 + 2 * 16 + 28 + 12 };
/* How often the points near each point are looked for: of each radius, while one is found, and while each point gets
 * its own, about: as dear as several passes that spread. */
enum { KILN_MERGE_PASSES = 4, KILN_MERGE_SEARCH_PASSES = 12, KILN_MERGE_FIT_PASSES = 8 };

#endif
