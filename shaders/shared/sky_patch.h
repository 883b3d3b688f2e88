/* Patch of the sky that contains a direction; worker/light/sky_patches.h describes the patches. */
#ifndef KILN_SHADERS_SHARED_SKY_PATCH_H
#define KILN_SHADERS_SHARED_SKY_PATCH_H

#include "shaders/shared/real.h"

/* Number of patches in each band, from the horizon up, for one division. */
KILN_CONSTANT KILN_U32 kiln_sky_bands[7] = {30u, 30u, 24u, 24u, 18u, 12u, 6u};

/* Radians. */
KILN_FUNCTION kiln_real kiln_sky_band_height(KILN_U32 n)
{
    return KILN_RATIO(1, 2) * KILN_REAL_PI / (7 * kiln_real_of(n) + KILN_RATIO(1, 2));
}

/* Returns the patch that contains a unit direction away from the scene, for n divisions; below the horizon it returns
 * the number of patches. */
KILN_FUNCTION KILN_U32 kiln_sky_patch(kiln_real3 d, KILN_U32 n)
{
    const kiln_real altitude = real_asin(real_min(real_max(d.y, kiln_real_of(-1)), kiln_real_of(1))),
                    bands = 7 * kiln_real_of(n);
    const KILN_U32 band = KILN_TO_U32(real_min(real_max(altitude, kiln_real_of(0)) / kiln_sky_band_height(n), bands));
    KILN_U32 first = 0u;
    if (d.y < 0)
        return 144u * n * n + 1u;
    for (KILN_U32 b = 0u; b < band; b++)
        first += n * kiln_sky_bands[b / n];
    if (band == 7u * n)
        return first;
    const KILN_U32 count = n * kiln_sky_bands[band / n];
    const kiln_real turn =
        real_atan2(d.x, -d.z) / (2 * KILN_REAL_PI) * kiln_real_of(count) + KILN_RATIO(1, 2); /* > -count */
    return first + KILN_TO_U32(KILN_TO_I32(real_floor(turn)) + KILN_TO_I32(count)) % count;
}

#endif
