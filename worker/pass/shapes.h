/* The shapes pass: the patch that stands for each surface point (worker/pass/patches.h), and what it emits.
 *
 * Of a point whose texel is one square of one triangle it is that square. Of any other it is a rectangle about the
 * middle of what of the point's surface is there and not buried, with the proportions of its covariance: exact where
 * that is of few pieces, else by 16 x 16 positions. What looks another way (by 45 degrees) than most of it, or lies
 * apart, is another surface that shares the texel: the rectangle lies where most of it is, and has all of the
 * area. The normal is the mean one. The place, where rays go, is the middle of one convex piece, or the position that
 * is nearest to the middle.
 *
 * Items: tile runs. Result: struct kiln_shape_result, all zeros for a point that is not valid. No parameters, no
 * samples, no streams, no rays. Embree only. */
#ifndef KILN_WORKER_PASS_SHAPES_H
#define KILN_WORKER_PASS_SHAPES_H

#include "worker/pass/patches.h"

struct kiln_shape_result {
    struct kiln_patch patch; /* area 0, with a place: on objects that no ray meets; its number is 0 */
    float emission[3];       /* W/m2: pi times the mean radiance over what is there of it */
};

#endif
