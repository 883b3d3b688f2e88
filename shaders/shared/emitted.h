/* A ray that leaves a light. */
#ifndef KILN_SHADERS_SHARED_EMITTED_H
#define KILN_SHADERS_SHARED_EMITTED_H

#include "shaders/shared/real.h"

struct kiln_emitted {
    KILN_U32 light;
    kiln_real3 origin, direction;
    /* radiance (or intensity, or irradiance) x cosine / density: W of the ray */
#ifdef KILN_GLSL
    vec3 flux;
#else
    double flux[3];
#endif
    kiln_real density; /* of the ray, 1/(m2 sr), with the light's probability; fixed point or direction: no factor */
    kiln_real cosine;  /* of the direction at the light; 1 where it has no surface */
    bool has_place;    /* the ray starts in the scene, not outside */
    bool is_point;     /* no ray can hit the light: a point, spot or directional light */
};

/* Sets the flux to light x factor / density. GLSL divides first: three products cost less than three quotients. */
KILN_FUNCTION void kiln_emitted_set_flux(KILN_INOUT(KILN_STRUCT kiln_emitted) ray, KILN_RGB_IN(light), kiln_real factor)
{
#ifdef KILN_GLSL
    ray.flux = vec3(kiln_real3(light) * (factor / ray.density));
#else
    for (int c = 0; c < 3; c++)
        ray->flux[c] = (double)light[c] * factor / ray->density;
#endif
}

#endif
