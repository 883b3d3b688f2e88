/* Light level of a scene: the brightness of its surfaces if its lights lit all of them alike. It bounds exposures. */
#ifndef KILN_COORDINATOR_VIEW_LIGHT_LEVEL_H
#define KILN_COORDINATOR_VIEW_LIGHT_LEVEL_H

#include "worker/light/lights.h"

/* Computes the light level, luminance of radiance in W m-2 sr-1: power of all lights / (pi x area of all surfaces). A
 * sun or the sky adds at most its light on an open white surface. 0 without lights or surfaces. Not collective. */
double kiln_light_level(const struct kiln_lights *lights, const struct kiln_geometry *geometry);

#endif
