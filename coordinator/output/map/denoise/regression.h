/* Surface regression: takes noise out of irradiance on a surface, by local regression whose scale and order each point
 * chooses for itself. Which points are neighbours: neighbours.h. All points of the surface must be given at once.
 *
 * At every point, for each scale s of 0.75, 1, 1.5, 2, 3 and 4 texels, a linear function of the tangent plane is
 * fitted to the values y_j of the neighbours and of the point itself, with the weights
 *
 *     w_j = area_j (1 - r_j^2 / (2 s)^2)^2     for r_j < 2 s                          (Epanechnikov's kernel, squared)
 *
 * For s of 1, 1.5, 2 and 4 a quadratic function is fitted too, with the same weights. A fit at the point is a sum over
 * l_j y_j; l_0 of the point itself is its leverage (Cleveland and Devlin, "Locally Weighted Regression", JASA 1988).
 * Stein's unbiased estimate of the fit's squared error is
 *
 *     (fit - y_0)^2 - v + 2 l_0 v                                   (Stein, Annals of Statistics 1981, Theorem 1),
 *
 * v being the variance of y_0: what is stated of it, averaged over neighbours with the weights of s = 3; where that
 * exceeds what the values scatter about the linear fit of s = 1 or the quadratic one of s = 1.5, it is lowered to that:
 * samples that stratify smooth light are better than they can tell, and by too large a variance curves are smeared. The
 * estimates over v are averaged with the weights of s = 3, too. What is chosen lies a part t of the way from the value
 * to a fit, at most all of it. Its estimate is v - 2 t (1 - l_0) v + t^2 (fit - y_0)^2; with the means of both it is
 * least at t = (1 - l_0) v / (fit - y_0)^2 (James and Stein, "Estimation with Quadratic Loss", 1961, for one fit). The
 * fit of least risk is chosen, if that is 0.9 v at most, else the value: light that is known well stays as it is,
 * however steep. Choices are averaged with the weights of s = 1, so that the result is a mean of a few
 * fits. All channels have the same weights; what is judged is luminance.
 *
 * The squared error that is left is the variance of that sum, sum over f_j^2 v_j, and the square of its bias. An
 * estimate of the bias is what the risk of the choices exceeds the variance by. But a risk is itself of few values, and
 * the least of ten is too low as a rule. So the bias, relative to v, is taken to be at least what it is in the mean
 * over all points, by area x v. Such sums are of whole numbers, 2^-62 of the largest term, so that they do not depend
 * on any order.
 *
 * A point's light depends on no more than the points within 30 texels, its error through that mean on all. Not
 * collective; the same bits for any number of threads. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_REGRESSION_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_REGRESSION_H

#include "coordinator/output/map/denoise/neighbours.h"

enum { KILN_REGRESSION_LIGHTS = 2 };

struct kiln_regression_device;

/* One kind of light: planes of irradiance, W/m2 or lux, by the points' index. Borrowed. */
struct kiln_regression_light {
    float *rgb[3];
    float *variance; /* of the luminance, its unit squared, as stated. The result has the squared error that is left: at
                      * most v, and above 0 where that is */
    /* further light, of which the same fits and their same mean are taken: `other_count` times three planes, likewise.
     * It may be below 0 then, unlike the light that the fits were chosen for: if it adds up to that, it still does */
    float *(*others)[3];
    size_t other_count;
    double before, after; /* results: sums of area x variance over the points, as it was taken, and what is left */
};

/* Where the points are not all of the surface: those with an index below `own` are counted, once on one rank, in sums
 * over all points. The others are there for their neighbours, and what becomes of them is of no use. */
struct kiln_regression_part {
    uint32_t own;
    const uint8_t *far; /* of each point by its index, the same for all of a cell: how many neighbours of neighbours lie
                         * between it and an own point, which is 0. So it is told what has to be known of it */
    int (*agree)(void *context, int status, struct kiln_error *error); /* the worst status of all ranks */
    /* replace numbers of this rank by the largest, and by the sum, of all ranks */
    int (*most)(void *context, double *numbers, size_t count, struct kiln_error *error);
    int (*sum)(void *context, uint64_t *numbers, size_t count, struct kiln_error *error);
    void *context;
};

/* Replaces the values of all lights, of which there are at most KILN_REGRESSION_LIGHTS. They are fitted apart, with the
 * same neighbours. `device`: does the sweeps where it can (regression_device.h) and no light has further light; NULL:
 * none does. `part` is NULL if the grid has all points of the surface; else it is collective, and
 * `grid` may be NULL on a rank without points. KILN_SYSTEM: what the planes hold is of no use then. */
int kiln_regression_run(const struct kiln_neighbour_grid *grid, struct kiln_regression_light *lights, size_t count,
                        const struct kiln_regression_part *part, struct kiln_regression_device *device,
                        struct kiln_error *error);

#endif
