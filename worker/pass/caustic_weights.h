/* How the three ways of finding a caustic's light weigh against each other: multiple importance sampling (Veach,
 * "Robust Monte Carlo Methods for Light Transport Simulation", 1997, section 9.2) by a recursion like that of vertex
 * connection and merging (Georgiev, "Implementing Vertex Connection and Merging", technical report, 2012, section 4),
 * of which only these techniques are left. A path is a lamp's place y, surfaces with gloss z_1 ... z_k, k >= 1, z_1 met
 * first by light, and a place x in a texel. It is found by
 *
 *     hit     a gather ray of x that goes on by z_k ... z_1 and meets the emitter or leaves for the sky; density
 *             (n / A) p(x -> z_k) ... p(z_1 -> y)
 *     sample  the same up to z_1, and a sample of the lights there
 *     land    a light path that is aimed from y at the target of z_1 (worker/light/aims.h) and lands at x; density
 *             N p(y -> z_1) ... p(z_k -> x)
 *
 * with n gather rays of the point, the texel's area A that is there to be lit, and N light paths of the aim in all.
 * Each subpath carries the densities of the techniques of the other side over its own, as a product over its surfaces;
 * from these each weight follows at once: with r the densities of the other techniques over a technique's own,
 *
 *     balance   1 / (1 + sum of r)          power     1 / (1 + sum of r^2)
 *     uniform   1 / (1 + how many r are above 0)
 *
 * Densities are per steradian where they say `forward` (with which the subpath is drawn on from a surface) or
 * `backward` (with which a subpath of the other side would leave by the way that this one has come); cosines are those
 * of geometric normals, absolute. At x gather rays count as drawn by the cosine to the geometric normal. Roulette,
 * chances of surfaces that let light through, and the chance of landing on a side with gloss are in no density: the
 * weights of a path add up to 1 all the same. What devices reckon too is in shaders/shared/caustic_weights.h.
 * Pure functions. */
#ifndef KILN_WORKER_PASS_CAUSTIC_WEIGHTS_H
#define KILN_WORKER_PASS_CAUSTIC_WEIGHTS_H

#include "shaders/shared/caustic_weights.h"

/* ---- landed ---- */

/* The weight of a landing by what kiln_caustic_others has said, `rays` gather rays of the point and its area, m2. */
static inline double kiln_caustic_weight_landed(enum kiln_mis mis, double others, double rays, double area)
{
    if (!(others > 0.0))
        return 1.0;
    return 1.0 / (1.0 + (mis == KILN_MIS_UNIFORM ? others : kiln_mis_share(mis, others * rays / area)));
}

#endif
