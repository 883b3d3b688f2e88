/* The environment's distribution: private to worker/light. */
#ifndef KILN_WORKER_LIGHT_ENVIRONMENT_H
#define KILN_WORKER_LIGHT_ENVIRONMENT_H

#include "worker/light/lights.h"

/* Sets lights->environment, its mean, and for an image the cumulative distributions by luminance x sin(theta). An image
 * is piecewise constant, both for sampling and for lookups. */
int kiln_environment_build(struct kiln_lights *lights, struct kiln_error *error);

/* Texels of an environment image. Functions: the texel of a direction (outwards); the direction of a place in a texel,
 * fx and fy in 0..1; the density per steradian with which kiln_environment_sample draws directions of a texel. */
void kiln_environment_texel(const struct kiln_lights *lights, struct kiln_dvec3 direction, uint32_t *x, uint32_t *y);
struct kiln_dvec3 kiln_environment_in_texel(const struct kiln_lights *lights, uint32_t x, uint32_t y, double fx,
                                            double fy);
double kiln_environment_texel_density(const struct kiln_lights *lights, uint32_t x, uint32_t y);

#endif
