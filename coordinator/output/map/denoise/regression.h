/* Surface regression: denoises irradiance on a surface by local regression, with scale and order chosen per point.
 * neighbours.h defines the neighbours. All points of the surface must be given at once.
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
 * where v is the variance of y_0: the stated variance, averaged over neighbours with the weights of s = 3. If that
 * exceeds the scatter of the values about the linear fit of s = 1 or the quadratic one of s = 1.5, v is lowered to the
 * scatter: stratified samples of smooth light are better than their own estimate, and too large a variance would smear
 * curves. The risk estimates over v are averaged with the weights of s = 3, too. The chosen result lies a fraction t,
 * at most 1, of the way from the value to a fit. Its estimate is v - 2 t (1 - l_0) v + t^2 (fit - y_0)^2; with the
 * means of both it is least at t = (1 - l_0) v / (fit - y_0)^2 (James and Stein, "Estimation with Quadratic Loss",
 * 1961, for one fit). The fit of least risk is chosen if its risk is at most 0.9 v, else the value itself: accurate
 * light stays unchanged, however steep. Choices are averaged with the weights of s = 1, so that the result is a mean of
 * a few fits. All channels have the same weights; the choice is by luminance.
 *
 * The remaining squared error is the variance of that sum, sum over f_j^2 v_j, plus its squared bias. The bias is
 * estimated as the excess of the choices' risk over the variance. But a risk is estimated from few values, and the
 * least of ten is usually too low. So the bias, relative to v, is taken to be at least its mean over all points,
 * weighted by area x v. Such sums are of whole numbers, 2^-62 of the largest term, so that they do not depend on any
 * order.
 *
 * A point's light depends only on the points within 30 texels; its error, through that mean, on all points. Not
 * collective; the same bits for any number of threads. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_REGRESSION_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_REGRESSION_H

#include "coordinator/output/map/denoise/neighbours.h"

enum { KILN_REGRESSION_LIGHTS = 2 };

/* Most bytes of neighbours that a regression keeps between its sweeps: of some 40,000 points. Others are searched in
 * each sweep. */
enum { KILN_REGRESSION_KEPT = 16 << 20 };

struct kiln_regression_device;

/* One kind of light: planes of irradiance, W/m2 or lux, by the points' index. Borrowed. */
struct kiln_regression_light {
    float *rgb[3];
    float *variance; /* stated variance of the luminance, in its unit squared. On return the remaining squared error: at
                      * most v, and above 0 where v is */
    /* additional light, smoothed with the same fits and the same mean: `other_count` times three planes, likewise. It
     * may become negative, unlike the light for which the fits were chosen; if it adds up to that light, it still
     * does */
    float *(*others)[3];
    size_t other_count;
    double before, after; /* results: sums over the points of area x variance, before and after */
};

/* Points that are a part of a surface. Points with an index below `own` count in sums over all points, each on one rank
 * only. The others only serve as neighbours, and their results are of no use. */
struct kiln_regression_subdomain {
    uint32_t own;
    const uint8_t *far; /* by index, the same for all points of a cell: number of neighbour steps to an own point; 0 for
                         * own points. It determines which of the point's data are needed */
    /* returns the worst status of all ranks; NULL, as the next two: no other rank has a part of the surface */
    int (*agree)(void *context, int status, struct kiln_error *error);
    /* replace this rank's numbers by the maximum, and by the sum, over all ranks */
    int (*most)(void *context, double *numbers, size_t count, struct kiln_error *error);
    int (*sum)(void *context, uint64_t *numbers, size_t count, struct kiln_error *error);
    void *context;
};

/* Denoises all lights in place, at most KILN_REGRESSION_LIGHTS, each fitted separately with the same neighbours.
 * `device` runs the sweeps if it can (regression_device.h) and no light has additional light; NULL: no device. `part`
 * is NULL if the grid has all points of the surface. Otherwise the call is collective, and `grid` may be NULL on a rank
 * without points. KILN_SYSTEM: the contents of the planes are of no use then. */
int kiln_regression_run(const struct kiln_neighbour_grid *grid, struct kiln_regression_light *lights, size_t count,
                        const struct kiln_regression_subdomain *part, struct kiln_regression_device *device,
                        struct kiln_error *error);

#endif
