/* The radiance pass: radiance that surfaces send to a place from the directions of one element of a map, for radiance
 * probes (worker/scene/radiance_probes.h).
 *
 *     L = integral over the element of  B(hit(x, w)) / pi  dw   /   its solid angle
 *
 * with hit(x, w) the nearest surface point that a ray from x in direction w meets and B its radiosity. Light straight
 * from lights and from the sky is not in it: the direct pass has that. A ray that meets the back of a single-sided
 * surface brings nothing; a surface that lets light through is met with a chance that is its opacity. Directions are
 * stratified over the element, evenly on its map, and weighed by the solid angle that they stand for; the result is
 * their weighted mean, so an element that sees one radiance everywhere has exactly that. Rays that meet a material that
 * is taken with its gloss go on in chains (shaders/shared/chain.h), which bring what they find of surfaces.
 *
 * Items: elements: item i is element i modulo the elements of a map, at batch->positions. Samples: rays of an element.
 * Streams: any. Rays: the samples of all items. */
#ifndef KILN_WORKER_PASS_RADIANCE_H
#define KILN_WORKER_PASS_RADIANCE_H

#include "worker/pass/pass.h"

struct kiln_radiance_parameters {
    uint32_t basis; /* which map: KILN_PROBE_CUBE, or another value for the octahedral one */
    uint32_t side;  /* elements along its side, at least 1 */
    /* items whose numbers differ by a multiple of it draw the same random numbers; 0: no two items do */
    uint32_t period;
};

struct kiln_radiance_result {
    float radiance[3]; /* W/(m2 sr) */
    float back;        /* share of the element whose rays met backs of solids (kiln_geometry_is_solid) */
};

#endif
