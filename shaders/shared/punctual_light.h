/* Point and spot lights as glTF's KHR_lights_punctual has them: the cone and the range. */
#ifndef KILN_SHADERS_SHARED_PUNCTUAL_LIGHT_H
#define KILN_SHADERS_SHARED_PUNCTUAL_LIGHT_H

#include "shaders/shared/real.h"

/* A spot light's share of its intensity at `cosine` from its axis; `width` is cos(inner) - cos(outer). */
KILN_FUNCTION kiln_real kiln_spot_cone(kiln_real cosine, kiln_real cos_outer, kiln_real width)
{
    const kiln_real t =
        real_clamp((cosine - cos_outer) / real_max(KILN_RATIO(1, 1000000000), width), kiln_real_of(0), kiln_real_of(1));
    return t * t;
}

/* What the range, m, leaves at a distance; 0: there is no range. */
KILN_FUNCTION kiln_real kiln_light_range(kiln_real range, kiln_real distance)
{
    if (range <= 0)
        return kiln_real_of(1);
    const kiln_real q = distance / range;
    return real_clamp(1 - q * q * q * q, kiln_real_of(0), kiln_real_of(1));
}

#endif
