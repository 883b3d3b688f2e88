/* How bright the surfaces of a scene would be if its lights lit all of them alike: what exposures are bounded by. */
#ifndef KILN_COORDINATOR_VIEW_LIGHT_LEVEL_H
#define KILN_COORDINATOR_VIEW_LIGHT_LEVEL_H

#include "worker/light/lights.h"

/* Luminance of radiance, W m-2 sr-1: the power of all lights over pi and the area of all surfaces, of a sun or the sky
 * at most what an open white surface has of it. 0 without lights or surfaces. Not collective. */
double kiln_light_level(const struct kiln_lights *lights, const struct kiln_geometry *geometry);

#endif
