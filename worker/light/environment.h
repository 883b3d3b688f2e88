/* The environment's distribution: private to worker/light. */
#ifndef KILN_WORKER_LIGHT_ENVIRONMENT_H
#define KILN_WORKER_LIGHT_ENVIRONMENT_H

#include "worker/light/lights.h"

/* Sets lights->environment, its mean, and for an image the cumulative distributions by luminance x sin(theta). An image
 * is taken as piecewise constant, by the light and by everything that looks at it alike. */
int kiln_environment_build(struct kiln_lights *lights, struct kiln_error *error);

#endif
