/* Near lights: point and spot lights so near a surface that its texels cannot resolve their light. The samples of a
 * texel lie anywhere in it. If a light is nearer than a texel is wide, most samples find too little light, and a few
 * far too much. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_NEAR_LIGHTS_H
#define KILN_COORDINATOR_BAKE_POINTS_NEAR_LIGHTS_H

#include "worker/light/lights.h"

struct kiln_near_light {
    size_t objects;  /* number of objects with such a light */
    uint32_t object; /* the object among them with the least distance / texel side */
    double distance; /* m */
    double side;     /* m: square root of the area of a texel there */
};

/* Finds near lights on each surface side that receives light. Not collective. */
struct kiln_near_light kiln_near_lights(const struct kiln_lights *lights);

#endif
