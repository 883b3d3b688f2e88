/* The standard errors of a bake in parts (parts.h).
 *
 * The mean m of K independent values x_k has the standard error sqrt(sum (x_k - m)^2 / (K (K - 1))): the method of
 * random groups (Wolter, "Introduction to Variance Estimation", chapter 2). From four values this estimate is off by 40
 * %, so its square is averaged over the points of the tile within two texels. Where cells cut a tile into tile runs,
 * ranks exchange the squares, since cells must not change a result. With a target error they do not: tile runs then are
 * finished one by one, with as many samples each as they needed.
 *
 * The parts are not independent: their samples are consecutive ranges of one Sobol' sequence and stratify one another,
 * so the mean is better than the formula says. Let v(n) be the variance of the mean of the first n samples. For four
 * ranges of n / 4 samples that together form a net of n, the formula gives V = (v(n / 4) - v(n)) / 3. A point's own
 * error comes from quarters of a part's rays, one level below: as a variance of the mean they give W = (v(n / 16) - v(n
 * / 4)) / 12. If v(n) falls as n^-p, 4 W / V is 4^p, and
 *
 *   v(n) = 3 V^2 / (4 W - V)
 *
 * with V and W averaged over all points, relative to the square of their light. But p falls with n: smooth parts
 * converge first, leaving edges, random masks and the noise of the bounces. So the formula is a lower bound of v(n),
 * with p at most 1.5, as at edges (Mitchell, "Consequences of Stratified Sampling in Graphics", SIGGRAPH 1996). V is
 * the upper bound (p = 1); if W is less than V, the noise of the bounces, which W lacks, prevails, and V is used.
 * Otherwise the stated variance is the geometric mean of both bounds. With fewer than four samples a part, which have
 * no quarters, it is V. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_PART_ERRORS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_PART_ERRORS_H

#include "coordinator/integrate/integrate.h"

#define KILN_PART_LEAST_LIGHT 0.1 /* fraction of the mean luminance: errors of darker points are relative to it */

/* Scene-wide values for the errors of all points; the same on all ranks. */
struct kiln_part_survey {
    double mean; /* luminance of the irradiance, by area */
    double gain; /* ratio of the stated variance to V */
    /* tiles with several tile runs, KILN_PART_ERRORS each: squared standard errors, -1 where absent; NULL: with a
     * target error */
    float *shared;
    uint32_t *shared_of; /* for the first entry of such a tile in `splits`: its number in `shared` */
};

enum { KILN_PART_ERRORS = 64 }; /* points of a tile, and so of a tile run, at most */

/* Place of a tile's bit, row by row: 8 y + x. Bits are in Morton order (kiln_morton8). */
static inline int kiln_part_place(uint32_t bit) { return (int)(8u * kiln_morton8_y(bit) + kiln_morton8_x(bit)); }

/* Collective, after a part with the reports `part`, when the field `error` holds the errors estimated from the points'
 * own rays. `unit`: of exact sums of power, W. KILN_SYSTEM. Release with kiln_part_survey_release, after a failure
 * too. */
int kiln_part_survey(const struct kiln_integrate_params *params, const struct kiln_rank_data *data,
                     const struct kiln_step_reports *part, double unit, struct kiln_part_survey *survey,
                     struct kiln_error *error);

void kiln_part_survey_release(struct kiln_part_survey *survey);

/* Returns the luminance of the irradiance at an own point, averaged over the parts so far. */
double kiln_part_light(const struct kiln_rank_data *data, uint64_t own);

/* Computes the standard errors of the luminance of a tile run's points, in their order. */
void kiln_part_errors(const struct kiln_rank_data *data, const struct kiln_tile_run *run,
                      const struct kiln_part_survey *survey, float errors[KILN_PART_ERRORS]);

#endif
