/* The direct pass: light that arrives at surface points straight from the lights.
 *
 *     E(x) = sum over the lights of the mean over samples y of  L(y -> x) V(x, y) max(0, n.w) / p(y)
 *
 * with w the direction from x to the sample y, L the radiance that y sends to x, V what the surfaces between them let
 * through, and p(y) the density of y in solid angle seen from x (Shirley, Wang and Zimmerman, "Monte Carlo Techniques
 * for Direct Lighting Calculations", ACM Transactions on Graphics 15(1), 1996). A point, spot or directional light is
 * one sample whose L / p is its irradiance on a facing surface. Where there are many lights, a cut through a tree of
 * lights chooses some (worker/light/lights.h), and p contains the chance of the choice. E about the shading normal s is
 * the same sum with max(0, s.w) in the place of max(0, n.w), where n.w > 0. If a point's material is taken with its
 * gloss, `incident` is only the light that its diffuse part takes up (kiln_chain_taken_up in shaders/shared/chain.h).
 *
 * The samples of a point start at places uniform over the part of its texel that is covered by a mesh, not buried
 * (validity.h) and not cut out by opacity. Surfaces that let light through attenuate it without random choices: V is
 * the product of the transmittances on the way.
 *
 * Items: tile runs. Result: struct kiln_point_result. No parameters. Samples: those of a point, dealt out to the lights
 * that are chosen; where a scene has an environment and directional lights, pilot samples change the distribution
 * (shaders/shared/sun_pilot.h), and a point at the edge of a shadow has up to four times the samples. Streams: any;
 * answers of two streams are independent. Rays: shadow rays, those of pilots included; samples that cannot bring light
 * have none. */
#ifndef KILN_WORKER_PASS_DIRECT_H
#define KILN_WORKER_PASS_DIRECT_H

#include "worker/pass/pass.h"
#include "worker/pass/point.h"

#endif
