/* The weighed pass: the caustic pass's light (caustic.h), of which each path counts by how well gather rays find it
 * against light paths that land (land.h): multiple importance sampling (caustic_weights.h).
 *
 * Rays, chains and results are those of the caustic pass, with these differences. All lobes of a chain's surfaces but
 * mirrors and smooth glass are hit by its rays and sampled from the lights, and each path's weight says which technique
 * brings how much of it: there are no sharp lobes. At each surface one sample is drawn of the tree of lights, one of
 * each directional light, and one, by luminance, of an environment with an image; through glass too. Gather rays of all
 * points and the landings of all light paths, whose parameters name the same techniques, add up to the light.
 *
 * Lamps without extent that flat mirrors show (worker/backend/mirror_images.h) are left to their images: of light that
 * one such reflection brings straight to a point the pass adds all, from the places of all samples, and landings bring
 * nothing.
 * Where light paths are kept, chance connects a ray's place with one surface where such a path has met gloss that is
 * neither a mirror nor smooth glass, picked in proportion to the flux that has arrived there: what that surface sends
 * on to the place, over the chance, if nothing is in the way. Each quarter of a point's samples has kept paths of its
 * own, so that the error, which is told from the quarters, has theirs in it; points share them. The backend traces
 * them where they are first needed: every rank the same.
 *
 * Items: tile runs. Samples: rays of a point, n of the weights; the texel's area is kiln_lit_area. Results, streams and
 * rays as of the caustic pass. Devices do not take
 * pilots, weights that pilots teach, images, kept paths, nor any of it where they trace by their ray-tracing pipeline
 * (kiln_backend_takes). */
#ifndef KILN_WORKER_PASS_WEIGHED_H
#define KILN_WORKER_PASS_WEIGHED_H

#include "worker/pass/caustic_weights.h"
#include "worker/pass/pass.h"
#include "worker/pass/point.h"

struct kiln_aims;
struct kiln_emission;
struct kiln_mirror_images;

/* --mis variance and correlation: a technique that is better than its densities say counts more. Of each technique
 * alone, with its light not weighed, with X what a ray of point x finds by it, by luminance:
 *
 *     variance      c = E(X^2) / Var(X) = 1 + mean^2 / variance (Grittmann, Georgiev, Slusallek, Krivanek,
 *                   "Variance-Aware Multiple Importance Sampling", 2019): balance makes the second moments of the
 *                   techniques least, which is more than their variance where a technique is sure of its light
 *     correlation   c = Var(X) / (n Var(mean of n rays)): how many independent rays one ray of the point is worth. Rays
 *                   that share what they find count less (Grittmann, Georgiev, Slusallek, "Correlation-Aware Multiple
 *                   Importance Sampling for Bidirectional Rendering Algorithms", 2021, where it follows from densities
 *                   of shared prefixes), those of a net, which part the light among them, more. A gather ray and its
 *                   samples of the lights share nothing with other rays of the point but, beyond 64 rays, its place on
 *                   texels that are more than one square
 *
 * Landings have c = 1 in both: they are different paths, each of which meets one of many texels, so that mean^2 is
 * next to nothing of E(X^2). Moments are summed up over a region of points, from pilot rays that bring no light: the
 * factors do not hang on what they weigh, and the light stays unbiased. */

/* --mis optimal: weights may be any that add up to 1. Those of balance do so with exchanges too (caustic_weights.h):
 * with F a point's light by balance and D what each exchange by 1 adds to it, nothing in the mean, the exchanges alpha
 * that make the variance of a region's points least solve
 *
 *     A alpha = b,      A = sum of Cov(D, D),      b = -sum of Cov(D, F)
 *
 * after Kondapaneni, Vevoda, Grittmann, Skrivan, Slusallek, Krivanek, "Optimal Multiple Importance Sampling", 2019.
 * There alpha multiplies the densities themselves, so that paths without light count too; here it multiplies the light
 * of each path, for chances that are in no density (roulette) would make the former vary without bound. With alpha
 * from -1 to 1 no weight is below 0. */

/* Of a point, from pilots, W2/m4. */
enum kiln_caustic_gathers { KILN_CAUSTIC_HIT, KILN_CAUSTIC_SAMPLE, KILN_CAUSTIC_GATHERS };
enum { KILN_CAUSTIC_PRODUCTS = 5 };
struct kiln_caustic_moments {
    union {
        struct { /* variance, correlation; by the techniques of enum kiln_caustic_gathers */
            float square[KILN_CAUSTIC_GATHERS];   /* E(X^2) */
            float variance[KILN_CAUSTIC_GATHERS]; /* Var(X), by the spread of the rays */
            float net[KILN_CAUSTIC_GATHERS];      /* n Var(mean), by the spread of the means of the rays' quarters */
        };
        /* optimal: covariances of the two exchanges, 0 with 0, 0 with 1, 1 with 1; of each with the light */
        float product[KILN_CAUSTIC_PRODUCTS];
    };
};

/* The parameters: what gather rays and light paths know of each other. All borrowed. */
struct kiln_caustic_techniques {
    const struct kiln_aims *aims; /* shared out; the same for all iterations */
    const struct kiln_emission *emission;
    uint64_t iterations;                     /* of aims->paths light paths */
    const struct kiln_mirror_images *images; /* NULL: there are none */
    enum kiln_mis mis;
    /* borrowed, by region, and the region of each own point; NULL: all are alike */
    const struct kiln_caustic_factors *factors;
    const uint32_t *region_of;
    /* pilots: of own points, which a batch without `take` fills in, of 8 samples at least and a multiple of 4; NULL:
     * rays bring light. And how many rays a point will have then */
    struct kiln_caustic_moments *moments;
    uint32_t rays;
    /* Light paths whose vertices are kept, by aims that are shared out for them; quarter q of a point's samples has
     * those of iteration first_kept + q. NULL: nothing is connected. */
    const struct kiln_aims *kept;
    uint64_t first_kept;
    double connections; /* the chance of a ray's place to be connected */
};

/* That a backend needs for a kept path, about: two vertices. */
enum { KILN_KEPT_PATH_BYTES = 2048 };

#endif
