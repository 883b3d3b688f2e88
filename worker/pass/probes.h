/* The probe pass: light that arrives at points in space, from all directions, for the irradiance volume.
 *
 *     L_lm = integral over the sphere of L(w) Y_lm(w) dw,   l <= 2
 *
 * with L(w) the radiance that arrives from direction w and Y_lm the real orthonormal spherical harmonics (Ramamoorthi
 * and Hanrahan, "An Efficient Representation for Irradiance Environment Maps", SIGGRAPH 2001, equations 3 and 10).
 * Light of surfaces (radiosity / pi) and of a constant sky is sampled by rays spread evenly over the sphere; each
 * stands for 4 pi / samples sr. The other lights are sampled as in the direct pass (direct.h). Rays that meet a
 * material taken with its gloss go on as chains, which collect light of surfaces, lamps and sky
 * (shaders/shared/chain.h).
 *
 * If light paths find some of the lamps' light that chains would find (spheres.h), chains leave it out.
 *
 * Items: positions. Samples: rays over the sphere, and as many again dealt out to the lights. Rays: those over the
 * sphere and the shadow rays. */
#ifndef KILN_WORKER_PASS_PROBES_H
#define KILN_WORKER_PASS_PROBES_H

#include "worker/pass/pass.h"

struct kiln_probe_parameters {
    /* bits KILN_LEAVES_... (shaders/shared/streams.h): kinds of lamps whose light chains do not collect by sharp lobes,
     * because light paths bring it (spheres.h) */
    uint32_t leaves;
};

/* Integrals, not sums: a probe's samples are not taken in stretches (kiln_pass.is_divisible), and a bake keeps this
 * struct for each of its probes as it is. */
struct kiln_probe_result {
    /* SH coefficients of incident radiance, W/(m2 sr) by the convention above, bands 0..2, order (l,m) = 00, 1-1, 10,
     * 11, 2-2, 2-1, 20, 21, 22, RGB for each */
    float radiance[9][3];
    float irradiance_axes[6][3]; /* W/m2: irradiance on faces looking along +x -x +y -y +z -z, estimated directly */
    /* m: arithmetic mean of hit distances; rays that escape count with the scene's diagonal */
    float mean_distance;
    float back_share; /* share of rays that met backs of solids (kiln_geometry_is_solid): near 1 inside */
};

#endif
