/* Lights as they are sampled, and their samples. */
#ifndef KILN_SHADERS_SHARED_LIGHT_STRUCTS_H
#define KILN_SHADERS_SHARED_LIGHT_STRUCTS_H

#include "shaders/shared/real.h"
#include "shaders/shared/surface.h"

/* An emissive triangle, or a part of one (worker/light/lamp_parts.h). */
struct kiln_area_light {
    kiln_stored3 p0;          /* corner 0; of a triangle in the world's order, */
    kiln_real3 e1, e2;        /* and the edges to corners 1 and 2 */
    kiln_stored3 normal;      /* unit, front face */
    kiln_real area;           /* m2 */
    kiln_real rounding;       /* m: what the corners' floats may be off by */
    KILN_RGB(radiance);       /* mean over it, of what is there: emission x opacity */
    KILN_U32 triangle;        /* world triangle */
    bool two_sided, textured; /* textured: its radiance is not the same all over */
    /* where `textured`: barycentric weights of the world triangle's corners 1 and 2 at its own corners; the way to it
     * from the triangle, `depth` highest bits, 0: it is the triangle; shaders/shared/area_light.h */
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
#define KILN_CHOICE_NODE 0u
#define KILN_CHOICE_DIRECTIONAL 1u
#define KILN_CHOICE_ENVIRONMENT 2u

struct kiln_light_choice {
    KILN_U32 kind;    /* KILN_CHOICE_... */
    KILN_U32 index;   /* node or directional light */
    KILN_U32 samples; /* set by kiln_lights_allot */
#ifndef KILN_GLSL
    double importance; /* about the irradiance it may bring, W/m2 */
#endif
};

/* One sample of a choice. The contribution to irradiance is value x max(0, n . direction) if nothing lies between p and
 * p + distance x direction. */
struct kiln_light_sample {
    kiln_real3 direction; /* unit */
    kiln_real distance;   /* m; infinite for light from outside */
    KILN_REAL_RGB(value); /* radiance / density of the direction */
    /* m: stop the shadow ray this much before the light (rounding of the light's own position) */
    kiln_real backoff;
    bool has_extent; /* a ray may meet it: an emitting triangle, or the environment */
    KILN_U32 light;  /* which of the tree's it is, areas first, then points; KILN_NONE: none of these */
};

#endif
