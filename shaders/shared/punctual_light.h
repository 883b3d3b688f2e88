/* Point and spot lights after glTF's KHR_lights_punctual: the only place that defines their emission.
 *
 * kiln_punctual_profile is the relative intensity in a direction. kiln_punctual_angle and kiln_punctual_sample describe
 * the directions with any intensity. kiln_punctual_share is what arrives at a place at a distance. */
#ifndef KILN_SHADERS_SHARED_PUNCTUAL_LIGHT_H
#define KILN_SHADERS_SHARED_PUNCTUAL_LIGHT_H

#include "shaders/shared/sphere.h"

struct kiln_point_light {
    kiln_stored3 position; /* m from the scene's centre */
    kiln_real3 direction;  /* spot: the way it points, unit */
    KILN_RGB(intensity);   /* W/sr */
    kiln_real range;       /* m, 0: none */
    kiln_real cos_inner, cos_outer;
    bool spot;
};

/* The share of the intensity that goes in unit `direction` from the light. */
KILN_FUNCTION kiln_real kiln_punctual_profile(KILN_IN(KILN_STRUCT kiln_point_light) light, kiln_real3 direction)
{
    if (!KILN_AT(light).spot)
        return kiln_real_of(1);
    const kiln_real cosine = real3_dot(KILN_AT(light).direction, direction),
                    width = real_max(KILN_RATIO(1, 1000000000), KILN_AT(light).cos_inner - KILN_AT(light).cos_outer),
                    t = real_clamp((cosine - KILN_AT(light).cos_outer) / width, kiln_real_of(0), kiln_real_of(1));
    return t * t;
}

/* 1 - cosine of the half-angle of the cone of emission; 2 for a light that emits all round. */
KILN_FUNCTION kiln_real kiln_punctual_cone(KILN_IN(KILN_STRUCT kiln_point_light) light)
{
    return KILN_AT(light).spot ? 1 - KILN_AT(light).cos_outer : kiln_real_of(2);
}

/* Solid angle of the cone of emission, sr, over which kiln_punctual_sample draws uniformly. */
KILN_FUNCTION kiln_real kiln_punctual_angle(KILN_IN(KILN_STRUCT kiln_point_light) light)
{
    return 2 * KILN_REAL_PI * kiln_punctual_cone(light);
}

/* A direction from the light for s and t in (0, 1); its length is 1 but for rounding. */
KILN_FUNCTION kiln_real3 kiln_punctual_sample(KILN_IN(KILN_STRUCT kiln_point_light) light, kiln_real s, kiln_real t)
{
    if (!KILN_AT(light).spot)
        return kiln_sphere_direction(s, t);
    const kiln_real z = 1 - s * kiln_punctual_cone(light), r = real_sqrt(real_max(kiln_real_of(0), 1 - z * z));
    kiln_real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * t, KILN_TO(sine), KILN_TO(cosine));
    return kiln_about_axis(KILN_AT(light).direction, r * cosine, r * sine, z);
}

/* Attenuation at a distance by the light's range, m. A range of 0 is unlimited. */
KILN_FUNCTION kiln_real kiln_light_range(kiln_real range, kiln_real distance)
{
    if (range <= 0)
        return kiln_real_of(1);
    const kiln_real q = distance / range;
    return real_clamp(1 - q * q * q * q, kiln_real_of(0), kiln_real_of(1));
}

/* Returns `weight` times the share of the intensity that is left at the distance, m, in unit `direction` from the
 * light. */
KILN_FUNCTION kiln_real kiln_punctual_share(KILN_IN(KILN_STRUCT kiln_point_light) light, kiln_real3 direction,
                                            kiln_real distance, kiln_real weight)
{
    return weight * kiln_punctual_profile(light, direction) * kiln_light_range(KILN_AT(light).range, distance);
}

#endif
