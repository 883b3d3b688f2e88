/* The standard errors of a bake in parts (parts.h).
 *
 * The standard error of a mean of K independent values x_k with the mean m is sqrt(sum (x_k - m)^2 / (K (K - 1))): the
 * method of random groups (Wolter, "Introduction to Variance Estimation", chapter 2). Of four values it is off by 40 %,
 * so its square is averaged over the points of the tile that are at most two texels away. Where cells cut a tile into
 * tile runs, ranks tell one another the squares, for cells must not change a result; but not with a target error, for
 * then tile runs are finished one by one, and have had as many samples each as they needed.
 *
 * The parts are not independent: their samples are stretches of one Sobol' sequence and stratify one another, which
 * makes the mean better than the formula says. Let v(n) be the variance of the mean of the first n samples. Four
 * stretches of n / 4 samples that make a net of n differ such that the formula gives V = (v(n / 4) - v(n)) / 3. The
 * quarters of a part's own rays, from which each point's own error comes, differ likewise, one level below: as a
 * variance of the mean that gives W = (v(n / 16) - v(n / 4)) / 12. If v(n) goes by n^-p, 4 W / V is 4^p, and
 *
 *   v(n) = 3 V^2 / (4 W - V)
 *
 * with V and W averaged over all points, relative to the square of their light. But p falls with n: what is smooth
 * converges first, and edges, the chances of masks and the noise of the bounces are left. So that is the least that
 * v(n) can be, where p is at most 1.5, as at edges (Mitchell, "Consequences of Stratified Sampling in Graphics",
 * SIGGRAPH 1996). V is the most (p = 1); where W is less than V, the noise of the bounces, which W does not have,
 * prevails, and V stands. What is stated is the geometric mean of the two; with fewer than four samples a part, which
 * have no quarters, V. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_PART_ERRORS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_PART_ERRORS_H

#include "coordinator/integrate/integrate.h"

#define KILN_PART_LEAST_LIGHT 0.1 /* of the mean luminance: errors of darker points are relative to this */

/* Scene-wide values for the errors of all points; the same on all ranks. */
struct kiln_part_survey {
    double mean; /* luminance of the irradiance, by area */
    double gain; /* what is stated over V */
    /* of tiles with several tile runs, KILN_PART_ERRORS each: squares of the standard errors, -1 where there is none;
     * NULL: with a target error */
    float *shared;
    uint32_t *shared_of; /* of such a tile's first entry in `splits`: its number in `shared` */
};

enum { KILN_PART_ERRORS = 64 }; /* of a tile, and so of a tile run, at most */

/* Collective, after a part with the reports `part`, while the field `error` has what the points' own rays state. `unit`
 * is that of exact sums of power, W. KILN_SYSTEM. Release with kiln_part_survey_release, after a failure too. */
int kiln_part_survey(const struct kiln_integrate_params *params, const struct kiln_rank_data *data,
                     const struct kiln_step_reports *part, double unit, struct kiln_part_survey *survey,
                     struct kiln_error *error);

void kiln_part_survey_release(struct kiln_part_survey *survey);

/* Luminance of the irradiance at an own point, as the parts so far have it. */
double kiln_part_light(const struct kiln_rank_data *data, uint64_t own);

/* The standard errors of the luminance of a tile run's points, one after the other. */
void kiln_part_errors(const struct kiln_rank_data *data, const struct kiln_tile_run *run,
                      const struct kiln_part_survey *survey, float errors[KILN_PART_ERRORS]);

#endif
