/* Weights of the three techniques that find a caustic's light: multiple importance sampling (Veach, "Robust Monte Carlo
 * Methods for Light Transport Simulation", 1997, section 9.2) by a recursion like that of vertex connection and merging
 * (Georgiev, "Implementing Vertex Connection and Merging", technical report, 2012, section 4), reduced to these
 * techniques. A path is a lamp's place y, surfaces with gloss z_1 ... z_k, k >= 1, z_1 met first by light, and a place
 * x in a texel. It is found by
 *
 *     hit     a gather ray of x that goes on by z_k ... z_1 and meets the emitter or leaves for the sky; density
 *             (n / A) p(x -> z_k) ... p(z_1 -> y)
 *     sample  the same up to z_1, and a sample of the lights there
 *     land    a light path that is aimed from y at the target of z_1 (worker/light/aims.h) and lands at x; density
 *             N p(y -> z_1) ... p(z_k -> x)
 *
 * with n the gather rays of the point, A the present (not cut out) area of the texel, and N all light paths of the aim.
 * Each subpath carries the ratios of the other side's densities to its own, as a product over its surfaces; from these
 * each weight follows at once: with r the densities of the other techniques over a technique's own,
 *
 *     balance   1 / (1 + sum of r)          power     1 / (1 + sum of r^2)
 *     uniform   1 / (1 + how many r are above 0)
 *
 * Densities are per steradian: `forward` is the density with which the subpath is continued from a surface, `backward`
 * the density with which a subpath of the other side would leave along the way this one came; cosines are those of
 * geometric normals, absolute. At x gather rays count as drawn by the cosine to the geometric normal. Roulette, chances
 * of surfaces that let light through, and the chance of landing on a side with gloss are left out of all densities; the
 * weights of a path still add up to 1. Code shared with devices is in shaders/shared/caustic_weights.h. Pure functions.
 */
#ifndef KILN_WORKER_PASS_CAUSTIC_WEIGHTS_H
#define KILN_WORKER_PASS_CAUSTIC_WEIGHTS_H

#include "shaders/shared/caustic_weights.h"

/* ---- weight of landed light paths ---- */

/* The weight of a landed light path. `others`: from kiln_caustic_others; `rays`: gather rays of the point; `area`: m2,
 * of the point. */
static inline double kiln_caustic_weight_landed(enum kiln_mis mis, double others, double rays, double area)
{
    if (!(others > 0.0))
        return 1.0;
    return 1.0 / (1.0 + (mis == KILN_MIS_UNIFORM ? others : kiln_mis_share(mis, others * rays / area)));
}

#endif
