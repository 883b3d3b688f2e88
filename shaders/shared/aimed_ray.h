/* Lamps that light paths leave towards targets, and the rays that they begin with (worker/light/aims.h). */
#ifndef KILN_SHADERS_SHARED_AIMED_RAY_H
#define KILN_SHADERS_SHARED_AIMED_RAY_H

#include "shaders/shared/real.h"
#include "shaders/shared/surface.h"

#define KILN_LAMP_AREA 0u
#define KILN_LAMP_POINT 1u
#define KILN_LAMP_DIRECTIONAL 2u
#define KILN_LAMP_ENVIRONMENT 3u

struct kiln_lamp {
    KILN_U32 kind;         /* KILN_LAMP_... */
    KILN_U32 first, count; /* area: the lights' emitting triangles; else `first` is the light's number of its kind */
    kiln_real flux;        /* area: luminance of all that it sends, W */
#ifndef KILN_GLSL
    uint32_t cell; /* environment: an image's cell of the sky */
    struct kiln_dvec3 centre;
#endif
};

/* The ray that a path begins with. */
struct kiln_aimed_ray {
    KILN_VECTOR origin, direction; /* m from the scene's centre; unit */
    KILN_REAL_RGB(flux);           /* W over the density, of one path of the aim */
    kiln_real range;               /* m: of a lamp that has one (kiln_light_range); 0: none */
    KILN_U32 light;                /* its number, as of worker/light/emission.h */
    kiln_real3 place;              /* on the lamp; of lamps that are outside `origin` */
    kiln_real cosine;              /* of the direction at the lamp; 1 where it has no surface */
    bool has_place, is_point;      /* it begins in the scene, not outside; no ray meets it */
    KILN_U32 triangle;             /* that was picked; KILN_NONE: it goes by sphere or box */
};

/* Random numbers in (0, 1) for such a ray: triangle of the lamp; side of it or of a box, or triangle of the target;
 * place; direction. */
struct kiln_aim_numbers {
    kiln_real triangle, side, s, t, u, v;
};

#endif
