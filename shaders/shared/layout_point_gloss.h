/* Points on materials that are taken with their gloss: what C and GLSL share of them. */
#ifndef KILN_SHADERS_SHARED_LAYOUT_POINT_GLOSS_H
#define KILN_SHADERS_SHARED_LAYOUT_POINT_GLOSS_H

#include "shaders/shared/bsdf_lobes.h"
#include "shaders/shared/layout.h"

/* Parts of struct kiln_bsdf_lobes, at the middle of such a point, that decide how much light it takes up. As large as
 * KILN_GPU_POINT_GLOSS_PARTS parts, which stand before the point's own. */
struct kiln_gpu_point_gloss {
    KILN_WORD model;
    KILN_REAL32 matt;            /* share of the base that is diffuse */
    KILN_REAL32 specular, color; /* of the reflection over it; the colour's largest channel */
    KILN_STRUCT kiln_interface face;
    KILN_REAL32 coat; /* its strength on the point's side */
    KILN_STRUCT kiln_interface coat_face;
    KILN_WORD reserved[11];
};
KILN_SIZE_IS(kiln_gpu_point_gloss, 224);

#endif
