/* Lights as they are sampled, and their samples. */
#ifndef KILN_SHADERS_SHARED_LIGHT_STRUCTS_H
#define KILN_SHADERS_SHARED_LIGHT_STRUCTS_H

#include "shaders/shared/real.h"
#include "shaders/shared/surface.h"

/* An emissive triangle, or a part of one (worker/light/lamp_parts.h). */
struct kiln_area_light {
    kiln_stored3 p0;          /* corner 0, in the world triangle's order */
    kiln_real3 e1, e2;        /* edges from corner 0 to corners 1 and 2 */
    kiln_stored3 normal;      /* unit, front face */
    kiln_real area;           /* m2 */
    kiln_real rounding;       /* m: rounding error of the corners' floats */
    KILN_RGB(radiance);       /* mean radiance over its area: emission x opacity */
    KILN_U32 triangle;        /* world triangle */
    bool two_sided, textured; /* textured: its radiance varies over it */
    /* only if `textured`: barycentric weights of the world triangle's corners 1 and 2 at this light's corners; path of
     * subdivision from the triangle to this light, `depth` highest bits, 0: it is the whole triangle;
     * shaders/shared/area_light.h */
#ifdef KILN_GLSL
    float at[6];
#else
    float at[3][2];
#endif
    KILN_U32 path, depth, turn;
};

struct kiln_directional_light {
    kiln_real3 towards; /* unit, towards the light */
    KILN_RGB(irradiance);
};

/* Kinds of struct kiln_light_choice */
#define KILN_CHOICE_LIGHT_NODE 0u
#define KILN_CHOICE_DIRECTIONAL 1u
#define KILN_CHOICE_ENVIRONMENT 2u

struct kiln_light_choice {
    KILN_U32 kind;    /* KILN_CHOICE_... */
    KILN_U32 index;   /* node or directional light */
    KILN_U32 samples; /* set by kiln_lights_allot */
#ifndef KILN_GLSL
    double importance; /* estimate of the irradiance that it brings, W/m2 */
#endif
};

/* One sample of a choice. The contribution to irradiance is value x max(0, n . direction) if nothing lies between p and
 * p + distance x direction. */
struct kiln_light_sample {
    kiln_real3 direction; /* unit */
    kiln_real distance;   /* m; infinite for light from outside */
    KILN_REAL_RGB(value); /* radiance / density of the direction */
    /* m: distance before the light at which the shadow ray ends (rounding of the light's position) */
    kiln_real backoff;
    bool has_extent; /* a ray can hit the light: an emitting triangle, or the environment */
    KILN_U32 light;  /* index of the light in the tree, areas first, then points; KILN_NONE: not in the tree */
};

#endif
