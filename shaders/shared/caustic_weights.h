/* MIS weights of the techniques for caustics, computed by both backends. worker/pass/caustic_weights.h explains the
 * weights and the names used here. Pure functions. */
#ifndef KILN_SHADERS_SHARED_CAUSTIC_WEIGHTS_H
#define KILN_SHADERS_SHARED_CAUSTIC_WEIGHTS_H

#include "shaders/shared/real.h"

#ifdef KILN_GLSL
const uint KILN_MIS_POWER = 1u, KILN_MIS_UNIFORM = 2u;
#else
enum kiln_mis { KILN_MIS_BALANCE = 0, KILN_MIS_POWER = 1, KILN_MIS_UNIFORM = 2 };
#endif

/* Returns a technique's term in the inverse of the weight of another; r: ratio of their densities. */
KILN_FUNCTION kiln_real kiln_mis_share(KILN_U32 mis, kiln_real r)
{
    if (mis == KILN_MIS_UNIFORM)
        return r > 0 ? kiln_real_of(1) : kiln_real_of(0);
    return mis == KILN_MIS_POWER ? r * r : r;
}

/* ---- from the texel ---- */

/* Sums of a gather ray's subpath. `land`: density of light paths / density of hits, without the factors at the lamp.
 * `sampled`: 1 / density of the last direction; 0 after a mirror or smooth glass, where light samples find nothing. */
struct kiln_caustic_gathered {
    kiln_real land, sampled;
};

/* Starts the sums of a gather ray at x. `area`: A, m2; `rays`: n. */
KILN_FUNCTION KILN_STRUCT kiln_caustic_gathered kiln_caustic_gather(kiln_real area, kiln_real rays)
{
    KILN_STRUCT kiln_caustic_gathered g;
    g.land = KILN_REAL_PI * area / rays;
    g.sampled = 0;
    return g;
}

/* Updates the sums when the ray arrives at a surface; `squared`: squared distance, m2. */
KILN_FUNCTION void kiln_caustic_arrive(KILN_INOUT(KILN_STRUCT kiln_caustic_gathered) g, kiln_real squared,
                                       kiln_real cosine)
{
    KILN_AT(g).land /= cosine;
    KILN_AT(g).sampled *= squared / cosine;
}

/* Updates the sums when the ray leaves a glossy surface. `delta`: by a mirror or smooth glass, with probabilities
 * instead of densities. */
KILN_FUNCTION void kiln_caustic_leave(KILN_INOUT(KILN_STRUCT kiln_caustic_gathered) g, kiln_real cosine,
                                      kiln_real forward, kiln_real backward, bool delta)
{
    KILN_AT(g).land *= cosine * backward / forward;
    KILN_AT(g).sampled = delta ? kiln_real_of(0) : 1 / forward;
}

/* Weight of a gather ray that hits a lamp. `connect`: density of a light sample there, per m2, or per steradian for the
 * environment; `emission`: N times the density of the aim's rays, per m2 and steradian (kiln_aims_density). */
KILN_FUNCTION kiln_real kiln_caustic_weight_hit(KILN_U32 mis, KILN_IN(KILN_STRUCT kiln_caustic_gathered) g,
                                                kiln_real connect, kiln_real emission)
{
    return 1 /
           (1 + kiln_mis_share(mis, connect * KILN_AT(g).sampled) + kiln_mis_share(mis, emission * KILN_AT(g).land));
}

/* Weight of a light sample at z_1. `towards`: cosine at z_1 / squared distance; for light from outside the scene the
 * cosine alone. `hit`: density with which the gather ray would continue to the sample, in the measure of `connect`; 0
 * if no ray can hit the lamp. */
KILN_FUNCTION kiln_real kiln_caustic_weight_sampled(KILN_U32 mis, KILN_IN(KILN_STRUCT kiln_caustic_gathered) g,
                                                    kiln_real connect, kiln_real emission, kiln_real towards,
                                                    kiln_real hit, kiln_real backward)
{
    return 1 / (kiln_mis_share(mis, hit / connect) + 1 +
                kiln_mis_share(mis, emission / connect * towards * KILN_AT(g).land * backward));
}

/* ---- from the lamp ---- */

/* Densities of hits and of light samples / density of a light path, without n / A and the factors at x. */
struct kiln_caustic_landing {
    kiln_real hit, sampled;
};

/* Starts the densities of a light path from the lamp to z_1. `connect`, `emission`: as in kiln_caustic_weight_hit.
 * `cosine`: at the lamp, 1 from outside the scene. `is_point`: no ray can hit the lamp. `squared`: squared distance to
 * z_1, m2, 1 from outside. `arrival`: cosine at z_1. */
KILN_FUNCTION KILN_STRUCT kiln_caustic_landing kiln_caustic_emit(kiln_real connect, kiln_real emission,
                                                                 kiln_real cosine, bool is_point, kiln_real squared,
                                                                 kiln_real arrival)
{
    KILN_STRUCT kiln_caustic_landing l;
    l.hit = is_point ? kiln_real_of(0) : cosine / (emission * arrival);
    l.sampled = connect * squared / (emission * arrival);
    return l;
}

/* Updates the densities when the path leaves a glossy surface with the cosine `leaving`. `first`: at z_1. */
KILN_FUNCTION void kiln_caustic_pass_on(KILN_INOUT(KILN_STRUCT kiln_caustic_landing) l, bool first, kiln_real leaving,
                                        kiln_real forward, kiln_real backward, bool delta)
{
    const kiln_real ratio = leaving / forward;
    KILN_AT(l).hit *= ratio * backward;
    KILN_AT(l).sampled *= first ? (delta ? kiln_real_of(0) : ratio) : ratio * backward;
}

/* Updates the densities when the path arrives at a glossy surface after z_1. */
KILN_FUNCTION void kiln_caustic_meet(KILN_INOUT(KILN_STRUCT kiln_caustic_landing) l, kiln_real cosine)
{
    KILN_AT(l).hit /= cosine;
    KILN_AT(l).sampled /= cosine;
}

/* Ends a light path that lands. Returns the sum from which the owner of the texel computes the weight, with n / A. */
KILN_FUNCTION kiln_real kiln_caustic_others(KILN_U32 mis, KILN_IN(KILN_STRUCT kiln_caustic_landing) l)
{
    const kiln_real sum = kiln_mis_share(mis, KILN_AT(l).hit) + kiln_mis_share(mis, KILN_AT(l).sampled);
    if (mis == KILN_MIS_UNIFORM)
        return sum;
    return (mis == KILN_MIS_POWER ? real_sqrt(sum) : sum) / KILN_REAL_PI;
}

#endif
