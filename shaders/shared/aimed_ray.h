/* Structs of aimed light paths: lamps, and the first rays from them towards targets (worker/light/aims.h). */
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
    kiln_real flux;        /* area: luminance of the emitted power, W */
#ifndef KILN_GLSL
    uint32_t cell; /* environment: an image's cell of the sky */
    struct kiln_dvec3 centre;
#endif
};

/* First ray of a light path. */
struct kiln_aimed_ray {
    KILN_VECTOR origin, direction; /* m from the scene's centre; unit */
    KILN_REAL_RGB(flux);           /* emitted light over the density of one path of the aim, W */
    kiln_real range;               /* range of the lamp, m (kiln_light_range); 0: unlimited */
    KILN_U32 light;                /* number of the light (worker/light/emission.h) */
    kiln_real3 place;              /* on the lamp; equals `origin` for lamps outside the scene */
    kiln_real cosine;              /* cosine of the direction at the lamp; 1 where it has no surface */
    bool has_place, is_point;      /* the lamp is in the scene, not outside; no ray can hit the lamp */
    KILN_U32 triangle;             /* the picked target triangle; KILN_NONE: aimed at sphere or box */
};

/* Random numbers in (0, 1) for an aimed ray. `triangle` picks the lamp's triangle; `side` its side, the side of a box,
 * or the target's triangle; s and t give the place on the lamp; u and v the direction. */
struct kiln_aim_numbers {
    kiln_real triangle, side, s, t, u, v;
};

#endif
