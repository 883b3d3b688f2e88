/* The shapes pass: the patch that stands for each surface point (worker/pass/patches.h), and what it emits.
 *
 * Of a point whose texel is one square of one triangle it is that square. Of any other it is a rectangle with the
 * point's area and, along the axes of their covariance, the proportions of 8 x 8 positions on what of the point's
 * surface is there and not buried; its place is the one of these that is nearest to their mean.
 *
 * Items: tile runs. Result: struct kiln_shape_result, all zeros for a point that is not valid. No parameters, no
 * samples, no streams, no rays. Embree only. */
#ifndef KILN_WORKER_PASS_SHAPES_H
#define KILN_WORKER_PASS_SHAPES_H

#include "worker/pass/patches.h"

struct kiln_shape_result {
    struct kiln_patch patch; /* area 0, with a place: on objects that no ray meets; its number is 0 */
    float emission[3];       /* W/m2: pi times the mean radiance of 8 x 8 positions */
};

#endif
