/* The radiance pass: mean radiance that arrives at a place from surfaces, over the directions of one element of a
 * probe's direction map; for radiance probes (worker/scene/radiance_probes.h).
 *
 *     L = integral over the element of  B(hit(x, w)) / pi  dw   /   its solid angle
 *
 * with hit(x, w) the nearest surface point that a ray from x in direction w meets and B its radiosity. Direct light of
 * lights and of the sky is excluded: it belongs to the direct pass. A ray that meets the back of a single-sided surface
 * brings nothing; a surface that lets light through stops a ray with a probability equal to its opacity. Directions are
 * stratified over the element, uniform on the map, and weighted by the solid angle that they stand for. The result is
 * the weighted mean, so it is exact if the radiance is constant. Rays that meet a material taken with its gloss go on
 * as chains (shaders/shared/chain.h), which collect light of surfaces only.
 *
 * Items: elements: item i is element i modulo the elements of a map, at batch->positions. Samples: rays of an element.
 * Streams: any. Rays: the samples of all items. */
#ifndef KILN_WORKER_PASS_RADIANCE_H
#define KILN_WORKER_PASS_RADIANCE_H

#include "worker/pass/pass.h"

struct kiln_radiance_parameters {
    uint32_t basis; /* direction map: KILN_PROBE_CUBE; any other value: octahedral */
    uint32_t side;  /* elements along its side, at least 1 */
    /* items whose numbers differ by a multiple of `period` use the same random numbers; 0: all items differ */
    uint32_t period;
};

struct kiln_radiance_result {
    float radiance[3]; /* W/(m2 sr) */
    float back;        /* share of the element whose rays met backs of solids (kiln_geometry_is_solid) */
};

#endif
