/* The shapes pass: computes the patch that replaces each surface point (worker/pass/patches.h), and its emission.
 *
 * If the texel is one whole square of one triangle, the patch is this square. Else it is a rectangle about the middle
 * of the point's surface that is present and not buried, with the proportions of the surface's covariance. The
 * covariance is exact for few pieces, else it is estimated from 16 x 16 positions. Parts whose normal is more than 45
 * degrees off, or that lie apart, are another surface in the same texel: the rectangle lies at the largest part, but
 * has the area of all parts. The normal is the mean normal. The place, where rays go, is the middle of one convex
 * piece, or the position nearest to the middle.
 *
 * Items: tile runs. Result: struct kiln_shape_result, all zeros for a point that is not valid. No parameters, no
 * samples, no streams, no rays. Embree only. */
#ifndef KILN_WORKER_PASS_SHAPES_H
#define KILN_WORKER_PASS_SHAPES_H

#include "worker/pass/patches.h"

struct kiln_shape_result {
    struct kiln_patch patch; /* area 0 but a place: object that no ray meets; number is 0 */
    float emission[3];       /* W/m2: pi times the mean radiance over its present surface */
};

#endif
