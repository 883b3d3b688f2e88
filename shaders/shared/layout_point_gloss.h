/* Points on materials with gloss: data that C and GLSL share. */
#ifndef KILN_SHADERS_SHARED_LAYOUT_POINT_GLOSS_H
#define KILN_SHADERS_SHARED_LAYOUT_POINT_GLOSS_H

#include "shaders/shared/bsdf_lobes.h"
#include "shaders/shared/layout.h"

/* Members of struct kiln_bsdf_lobes, evaluated at the middle of the point, that determine its absorption. The struct
 * takes the space of KILN_GPU_POINT_GLOSS_PIECES parts, in front of the point's own parts. */
struct kiln_gpu_point_gloss {
    KILN_WORD model;
    KILN_REAL32 matt;            /* share of the base that is diffuse */
    KILN_REAL32 specular, color; /* strength of the specular reflection above it; its colour's largest channel */
    KILN_STRUCT kiln_interface face;
    KILN_REAL32 coat; /* coat strength on the point's side */
    KILN_STRUCT kiln_interface coat_face;
    KILN_WORD reserved[11];
};
KILN_SIZE_IS(kiln_gpu_point_gloss, 224);

#endif
