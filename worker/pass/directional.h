/* The directional pass: from which directions light arrives at surface points, as spherical harmonics.
 *
 *     L_lm(x) = integral over the hemisphere of L(x, w) Y_lm(w) dw,   l <= 1
 *
 * with L(x, w) the radiance that arrives at x from direction w, from lights and from other surfaces, Y_lm the real
 * orthonormal spherical harmonics in world space (shaders/shared/harmonics.h), and the hemisphere that of the geometric
 * normal. They give the irradiance on a surface with unit normal n as (Ramamoorthi and Hanrahan, "An Efficient
 * Representation for Irradiance Environment Maps", SIGGRAPH 2001, equations 7 to 10, bands 0 and 1)
 *
 *     E(n) = pi Y_00 L_00 + (2 pi / 3) sum over m of Y_1m(n) L_1m
 *
 * Light of surfaces (radiosity / pi) and of a constant sky is sampled by rays spread evenly over the hemisphere; each
 * stands for 2 pi / samples sr. The other lights are sampled as in the probe pass (probes.h); only light from above the
 * geometric surface counts. Places on the texel are drawn as in the gather pass (gather.h), whose treatment of backs,
 * of surfaces that let light through and of tints holds here, too. Chains (shaders/shared/chain.h) bring light of
 * surfaces, lamps and sky.
 *
 * Items: tile runs. Result: struct kiln_directional_result, all zeros for a point that is not valid. No parameters.
 * Samples: rays over the hemisphere, and as many again dealt out to the lights. Rays: the former of all valid points,
 * and the shadow rays. */
#ifndef KILN_WORKER_PASS_DIRECTIONAL_H
#define KILN_WORKER_PASS_DIRECTIONAL_H

#include "worker/pass/pass.h"

enum { KILN_DIRECTIONAL_HARMONICS = 4 };

/* Sums over samples. Lights that each have only some of the samples have no plain sum; theirs is `count` times the
 * mean. */
struct kiln_directional_result {
    /* count x L_lm, W/(m2 sr) by the convention above, order (l,m) = 00, 1-1, 10, 11, RGB for each; kiln_mean divides
     */
    float radiance[KILN_DIRECTIONAL_HARMONICS][3];
    uint32_t count; /* samples */
};

#endif
