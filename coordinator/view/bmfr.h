/* Blockwise multi-order feature regression: denoises a view by features of its surfaces (Koskela et al., "Blockwise
 * Multi-Order Feature Regression for Real-Time Path-Tracing Reconstruction", ACM TOG 38(5), 2019).
 *
 * The light is y = (radiance - emission) / albedo. In blocks of 32 x 32 pixels y is fitted by least squares to the
 * features 1, normal (x, y, z), position (x, y, z) and its squares. Positions are scaled to -1 to 1 in each block. A
 * feature is left out if the features before it explain all but a thousandth of it; Koskela et al. add noise to
 * features instead. The fit is the projection onto an orthonormal basis of the features (modified Gram-Schmidt, which
 * is as good as Householder's QR for this: Bjorck, "Solving linear least squares problems by Gram-Schmidt
 * orthogonalization", BIT 7, 1967). Blocks overlap by half. Their fits are averaged with weights that fall to 0 at a
 * block's edge, so that block edges are invisible. Blocks are cut off at the border of the picture.
 *
 * A fit would blur light that features do not explain, such as shadows. So a pixel is moved from its own light towards
 * the fit f by a fraction t, at most 1:
 *
 *     t = (1 - l) v / (v + b^2),    b^2 = max(0, d - v)
 *
 * v is the mean of the stated variance of y, and d the mean of (f - y)^2, both of luminance, over the window of 9 x 9
 * pixels around the pixel; l is the leverage of the pixel in the fit. This t minimises the squared error if b is the
 * bias of the fit (derived in coordinator/output/map/denoise/regression.h). A pixel whose deviation is more than 20
 * times the mean over its blocks is an outlier: windows leave it out, as it would dominate them, and its v is its own
 * variance. Not collective; the same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_BMFR_H
#define KILN_COORDINATOR_VIEW_BMFR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Planes of width x height values, row by row; all are borrowed. */
struct kiln_bmfr {
    uint32_t width, height;
    uint32_t shift[2];        /* offset of the blocks to the left and up, pixels; varies from frame to frame */
    const bool *filtered;     /* true: the pixel is filtered; the light of others does not change */
    const float *normal[3];   /* unit, or a mean of unit vectors */
    const float *position[3]; /* m */
    float *light[3];          /* y; the result */
    const float *deviation;   /* standard error of the luminance of y; may be a one-sample estimate */
};

/* KILN_SYSTEM; the light is then as it was. */
int kiln_bmfr_run(const struct kiln_bmfr *picture, struct kiln_error *error);

#endif
