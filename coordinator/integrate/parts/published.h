/* Error of published light, as the parts of a bake show it (parts.h).
 *
 * Published light is what a lightmap shows: denoised, and looked at as an eye does, which takes neighbouring texels
 * together. Its error at a texel is that of the mean over the 5 x 5 texels around it, over the light there or a
 * twentieth of its object's mean, whichever is more. It is taken from what the four parts' means over these texels
 * differ by (method of random groups: Wolter, "Introduction to Variance Estimation", chapter 2), so that noise of the
 * bounces counts, which neighbours share. Texels of a tile share one such error, for four values know a variance badly.
 * Denoising leaves less than that mean has where light is smooth, and about as much where it is not.
 *
 * The error of a whole bake is what 95 % of its texels stay below: errors are taken to be normal, so it is the x where
 * the mean over all texels of erfc(x / (sqrt(2) s)) is 0.05, s being the standard error of each. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_PUBLISHED_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_PUBLISHED_H

#include "coordinator/integrate/integrate.h"

#define KILN_PUBLISHED_SHARE 0.95 /* of the texels that stay below the error */

/* Floors of relative errors, and a histogram of errors. Release with kiln_published_release. */
struct kiln_published {
    double *dark;      /* of each object: a twentieth of its mean luminance */
    double gain;       /* of variances: struct kiln_part_survey */
    uint64_t *numbers; /* of points, by their error: internal */
};

/* Collective, after a part. Finds the floors. `gain`: by kiln_part_survey; `unit`: of exact sums of power, W.
 * KILN_SYSTEM; release after a failure, too. */
int kiln_published_begin(struct kiln_published *p, const struct kiln_integrate_params *params,
                         const struct kiln_rank_data *data, double gain, double unit, struct kiln_error *error);

/* The standard error of published light in a tile run, relative: root mean square over its points. Enters the points
 * into the histogram. */
double kiln_published_tile(struct kiln_published *p, const struct kiln_rank_data *data,
                           const struct kiln_tile_run *run);

/* Collective, after all tile runs. The relative error that KILN_PUBLISHED_SHARE of all points stay below. */
double kiln_published_reached(struct kiln_published *p, MPI_Comm communicator);

void kiln_published_release(struct kiln_published *p);

#endif
