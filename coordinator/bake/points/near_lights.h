/* Point and spot lights so near a surface that its texels cannot tell what they bring. The samples of a texel lie
 * anywhere in it; of a light nearer than the texel is wide they find mostly too little, and now and then far too
 * much. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_NEAR_LIGHTS_H
#define KILN_COORDINATOR_BAKE_POINTS_NEAR_LIGHTS_H

#include "worker/light/lights.h"

struct kiln_near_light {
    size_t objects;  /* how many have such a light */
    uint32_t object; /* of those the one with the least distance / side of a texel */
    double distance; /* m */
    double side;     /* m: root of the area of one of its texels there */
};

/* Looks at each side of a surface that receives light. Not collective. */
struct kiln_near_light kiln_near_lights(const struct kiln_lights *lights);

#endif
