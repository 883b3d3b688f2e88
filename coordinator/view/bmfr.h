/* Blockwise multi-order feature regression: takes noise out of a view by what is known of its surfaces (Koskela et al.,
 * "Blockwise Multi-Order Feature Regression for Real-Time Path-Tracing Reconstruction", ACM TOG 38(5), 2019).
 *
 * In blocks of 32 x 32 pixels the light y, radiance without emission over albedo, is fitted by least squares by 1, the
 * normal (x, y, z), the position (x, y, z) and its squares. Positions are scaled with the block, to -1 to 1. A feature
 * that the ones before it explain but for a thousandth is left out; Koskela et al. add noise to features instead. The
 * fit is the projection onto an orthonormal basis of the features (modified Gram-Schmidt, which is as good as
 * Householder's QR for this: Bjorck, "Solving linear least squares problems by Gram-Schmidt orthogonalization", BIT 7,
 * 1967). Blocks overlap by half, and their fits are averaged with weights that fall to 0 at a block's edge, so that no
 * edges of blocks are seen. Blocks end where the picture does.
 *
 * What features do not explain, such as shadows, a fit would blur. So a pixel goes only a part t
 * of the way from its own light to the fit f, at most all of it:
 *
 *     t = (1 - l) v / (v + b^2),    b^2 = max(0, d - v)
 *
 * with the means v of the stated variances of y, and d of (f - y)^2, of luminance, over the window of 9 x 9 pixels
 * around it, and l, the leverage of the pixel in the fit. This is the t of least squared error, if b is the fit's bias
 * (coordinator/output/map/denoise/regression.h derives it). A pixel whose deviation is more than 20 times the mean over
 * its blocks is left out of windows, for it would speak for all pixels around it, and has its own variance for v. Not
 * collective; the same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_BMFR_H
#define KILN_COORDINATOR_VIEW_BMFR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Planes of width x height values, row by row; all are borrowed. */
struct kiln_bmfr {
    uint32_t width, height;
    uint32_t shift[2];        /* of the blocks to the left and up, pixels: another one for each frame of a sequence */
    const bool *filtered;     /* whether the pixel takes part; the light of others stays as it is */
    const float *normal[3];   /* 1 long, or a mean of such */
    const float *position[3]; /* m */
    float *light[3];          /* y; the result */
    const float *deviation;   /* stated standard error of the luminance of y; a single draw of it serves too */
};

/* KILN_SYSTEM; the light is then as it was. */
int kiln_bmfr_run(const struct kiln_bmfr *picture, struct kiln_error *error);

#endif
