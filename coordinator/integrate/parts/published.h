/* Error of published light, as the parts of a bake show it (parts.h).
 *
 * Published light is what a lightmap shows: denoised, and looked at as an eye does, which takes neighbouring texels
 * together. Its error at a texel is that of the mean over the 5 x 5 texels around it, over the light there or a
 * twentieth of its object's mean, whichever is more. The error of a bake is what 95 % of its texels stay below.
 *
 * Raw light: half of what two halves of the four parts differ by, in the mean over these texels, is as large as the
 * error of the mean of all, and has its distribution (method of random groups: Wolter, "Introduction to Variance
 * Estimation", chapter 2); noise of the bounces, which neighbours share, is in it. The error of a bake is what 95 % of
 * these are below, over all texels and all three ways to halve four parts: light that comes through one door has the
 * same error everywhere behind it, of which one way could tell too little by chance. (Less where parts stratify one
 * another: times the root of `gain` of struct kiln_part_survey.)
 *
 * What a tile run needs is judged by the variance of its texels, of which four values know little: texels of a tile
 * share it. Errors are taken to be normal there, and of the size that gives the error of the bake.
 *
 * Denoised light: over a sample of the surface (coordinator/integrate/denoising.h), the means A and B of parts 0 and 1,
 * and of 2 and 3, are denoised each by itself, to a and b. Half of a - b is as large as the noise of (a + b) / 2: no
 * model of the denoiser is needed. It has no bias in it, which both share. Bias is seen where (a + b) / 2 differs from
 * (A + B) / 2 by more than three standard errors of raw light, and is what is left of that difference without its
 * variance. The ratio of the 95 % quantile of these errors to that of half of A - B in the same sample, times the error
 * of raw light, is the error of the bake, times 1.1: bias that is not seen so, such as the blur of caustics, was found
 * to add up to that. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_PUBLISHED_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_PUBLISHED_H

#include "coordinator/integrate/denoising.h"
#include "coordinator/integrate/integrate.h"

#define KILN_PUBLISHED_SHARE 0.95 /* of the texels that stay below the error */
#define KILN_PUBLISHED_DARK 0.05  /* of an object's mean light: errors are relative to that at least */

struct kiln_part_survey;

/* Errors, relative. Release with kiln_published_release. */
struct kiln_published {
    const struct kiln_part_survey *survey; /* borrowed */
    double *dark, *texel;                  /* of each object: a twentieth of its mean luminance; area of a point, m2 */
    double gain;                           /* of variances: struct kiln_part_survey */
    double scale;                          /* errors of denoised light over those of raw light; 1: not known */
    double texel_loss;                     /* parts/texel_loss.h; 0: not known */
    float *raw;                            /* of each own tile run: standard error of raw light (tile_pool.h) */
    float *bias;                           /* of each own tile run; 0: none seen */
    uint32_t *weight;                      /* of each own tile run: of its points, by coverage */
    uint64_t *contrasts;                   /* of points, by what halves of the parts differ by: internal */
    uint64_t *numbers, *unfinished;        /* of points, and of those that go on, by raw error: internal */
};

/* Room for the errors of `runs` tile runs and `objects` objects, all 0, with gain and scale 1. Not collective.
 * KILN_SYSTEM; release after a failure, too. */
int kiln_published_allocate(struct kiln_published *p, size_t objects, size_t runs, struct kiln_error *error);

/* Collective, after the last part of a round, whose samples the field samples_taken has. Finds the errors of raw light.
 * `survey` is borrowed. `unit`: of exact sums of power, W. KILN_SYSTEM; release after a failure, too. */
int kiln_published_begin(struct kiln_published *p, const struct kiln_integrate_params *params,
                         const struct kiln_rank_data *data, const struct kiln_part_survey *survey, double unit,
                         struct kiln_error *error);

/* The error of raw light that KILN_PUBLISHED_SHARE of all points stay below; by the variances of tile runs. */
double kiln_published_raw(const struct kiln_published *p);
double kiln_published_raw_normal(const struct kiln_published *p);
/* Sets `scale` so that the errors of tile runs add up to the error `reached`. */
void kiln_published_rescale(struct kiln_published *p, double reached);
/* Likewise, of the points of tile runs that kiln_published_goes_on has noted, after kiln_published_gather. */
double kiln_published_raw_of_those(const struct kiln_published *p);

/* Collective. The error of denoised light that KILN_PUBLISHED_SHARE of the points stay below, by a sample; sets `scale`
 * and `bias`. `params` must have `denoising`. KILN_SYSTEM. */
int kiln_published_denoised(struct kiln_published *p, const struct kiln_integrate_params *params,
                            const struct kiln_rank_data *data, double *reached, struct kiln_error *error);

/* Standard error of published light in an own tile run: root mean square over its points. */
double kiln_published_of(const struct kiln_published *p, size_t tile_run);

/* Notes that an own tile run gets more samples. */
void kiln_published_goes_on(struct kiln_published *p, size_t tile_run);
/* Collective. Sums up what all ranks have noted. */
void kiln_published_gather(struct kiln_published *p, MPI_Comm communicator);

/* The share of all points expected to have an error above x, if those that go on get up to `times` as many samples, and
 * none more than bring their standard error to `enough`. */
double kiln_published_expected(const struct kiln_published *p, double times, double enough, double x);

void kiln_published_release(struct kiln_published *p);

#endif
