/* The weights of caustics' techniques that both backends reckon: worker/pass/caustic_weights.h says what they are, and
 * what the names here mean. Pure functions. */
#ifndef KILN_SHADERS_SHARED_CAUSTIC_WEIGHTS_H
#define KILN_SHADERS_SHARED_CAUSTIC_WEIGHTS_H

#include "shaders/shared/real.h"

#ifdef KILN_GLSL
const uint KILN_MIS_POWER = 1u, KILN_MIS_UNIFORM = 2u;
#else
enum kiln_mis { KILN_MIS_BALANCE = 0, KILN_MIS_POWER = 1, KILN_MIS_UNIFORM = 2 };
#endif

/* Returns the term that a technique whose density is r times as large adds to the inverse of a weight. */
KILN_FUNCTION kiln_real kiln_mis_share(KILN_U32 mis, kiln_real r)
{
    if (mis == KILN_MIS_UNIFORM)
        return r > 0 ? kiln_real_of(1) : kiln_real_of(0);
    return mis == KILN_MIS_POWER ? r * r : r;
}

/* ---- from the texel ---- */

/* Sums of a gather ray's subpath. `land`: the density of light paths over that of hits, but for what the lamp's end
 * adds. `sampled`: one over the density of the last direction; 0 after a mirror or smooth glass, where no sample of the
 * lights finds what comes that way. */
struct kiln_caustic_gathered {
    kiln_real land, sampled;
};

/* A ray leaves x. `area`: m2, A. */
KILN_FUNCTION KILN_STRUCT kiln_caustic_gathered kiln_caustic_gather(kiln_real area, kiln_real rays)
{
    KILN_STRUCT kiln_caustic_gathered g;
    g.land = KILN_REAL_PI * area / rays;
    g.sampled = 0;
    return g;
}

/* The ray arrives at a surface; `squared`: m2, of the distance. */
KILN_FUNCTION void kiln_caustic_arrive(KILN_INOUT(KILN_STRUCT kiln_caustic_gathered) g, kiln_real squared,
                                       kiln_real cosine)
{
    KILN_AT(g).land /= cosine;
    KILN_AT(g).sampled *= squared / cosine;
}

/* The ray leaves a surface with gloss. `delta`: by a mirror or smooth glass, whose densities are chances. */
KILN_FUNCTION void kiln_caustic_leave(KILN_INOUT(KILN_STRUCT kiln_caustic_gathered) g, kiln_real cosine,
                                      kiln_real forward, kiln_real backward, bool delta)
{
    KILN_AT(g).land *= cosine * backward / forward;
    KILN_AT(g).sampled = delta ? kiln_real_of(0) : 1 / forward;
}

/* The weight of a hit. `connect`: the density of a sample of the lights at the lamp's place, per m2, or per steradian
 * of the environment; `emission`: N times that of the aim's rays, per m2 and steradian (kiln_aims_density). */
KILN_FUNCTION kiln_real kiln_caustic_weight_hit(KILN_U32 mis, KILN_IN(KILN_STRUCT kiln_caustic_gathered) g,
                                                kiln_real connect, kiln_real emission)
{
    return 1 /
           (1 + kiln_mis_share(mis, connect * KILN_AT(g).sampled) + kiln_mis_share(mis, emission * KILN_AT(g).land));
}

/* The weight of a sample of the lights at z_1. `towards`: the cosine at z_1 over the
 * squared distance, without the latter from outside. `hit`: the density with which the gather ray would go on to the
 * lamp's place, in the measure of `connect`; 0 where no ray meets it. */
KILN_FUNCTION kiln_real kiln_caustic_weight_sampled(KILN_U32 mis, KILN_IN(KILN_STRUCT kiln_caustic_gathered) g,
                                                    kiln_real connect, kiln_real emission, kiln_real towards,
                                                    kiln_real hit, kiln_real backward)
{
    return 1 / (kiln_mis_share(mis, hit / connect) + 1 +
                kiln_mis_share(mis, emission / connect * towards * KILN_AT(g).land * backward));
}

/* ---- from the lamp ---- */

/* Densities of hits and of samples over that of a light path, but for n / A and what x adds. */
struct kiln_caustic_landing {
    kiln_real hit, sampled;
};

/* A light path leaves the lamp: `connect` and `emission` as above, `cosine` that at the lamp, 1 from outside.
 * `is_point`: no ray meets the lamp. The path arrives at z_1 after `squared` m2, 1 from outside, with the cosine
 * `arrival`. */
KILN_FUNCTION KILN_STRUCT kiln_caustic_landing kiln_caustic_emit(kiln_real connect, kiln_real emission,
                                                                 kiln_real cosine, bool is_point, kiln_real squared,
                                                                 kiln_real arrival)
{
    KILN_STRUCT kiln_caustic_landing l;
    l.hit = is_point ? kiln_real_of(0) : cosine / (emission * arrival);
    l.sampled = connect * squared / (emission * arrival);
    return l;
}

/* The path leaves a surface with gloss, z_1 if it is the `first`, by the cosine `leaving`. */
KILN_FUNCTION void kiln_caustic_pass_on(KILN_INOUT(KILN_STRUCT kiln_caustic_landing) l, bool first, kiln_real leaving,
                                        kiln_real forward, kiln_real backward, bool delta)
{
    const kiln_real ratio = leaving / forward;
    KILN_AT(l).hit *= ratio * backward;
    KILN_AT(l).sampled *= first ? (delta ? kiln_real_of(0) : ratio) : ratio * backward;
}

/* The path arrives at a later surface with gloss. */
KILN_FUNCTION void kiln_caustic_meet(KILN_INOUT(KILN_STRUCT kiln_caustic_landing) l, kiln_real cosine)
{
    KILN_AT(l).hit /= cosine;
    KILN_AT(l).sampled /= cosine;
}

/* The path lands. Returns what the owner of the texel needs for its weight, besides n / A. */
KILN_FUNCTION kiln_real kiln_caustic_others(KILN_U32 mis, KILN_IN(KILN_STRUCT kiln_caustic_landing) l)
{
    const kiln_real sum = kiln_mis_share(mis, KILN_AT(l).hit) + kiln_mis_share(mis, KILN_AT(l).sampled);
    if (mis == KILN_MIS_UNIFORM)
        return sum;
    return (mis == KILN_MIS_POWER ? real_sqrt(sum) : sum) / KILN_REAL_PI;
}

#endif
