/* The environment's distribution: private to worker/light. */
#ifndef KILN_WORKER_LIGHT_ENVIRONMENT_H
#define KILN_WORKER_LIGHT_ENVIRONMENT_H

#include "worker/light/lights.h"

/* Sets lights->environment, its mean, and for an image the cumulative distributions by luminance x sin(theta). An image
 * is taken as piecewise constant, by the light and by everything that looks at it alike. */
int kiln_environment_build(struct kiln_lights *lights, struct kiln_error *error);

/* Texels of an image: the texel of a direction, outwards; a direction by its place within a texel, x and y in 0..1; and
 * how densely kiln_environment_sample draws directions of a texel, per steradian. */
void kiln_environment_texel(const struct kiln_lights *lights, struct kiln_dvec3 direction, uint32_t *x, uint32_t *y);
struct kiln_dvec3 kiln_environment_in_texel(const struct kiln_lights *lights, uint32_t x, uint32_t y, double fx,
                                            double fy);
double kiln_environment_texel_density(const struct kiln_lights *lights, uint32_t x, uint32_t y);

#endif
