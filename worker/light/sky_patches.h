/* Patches of the sky: Tregenza's 145 ("Subdivision of the sky hemisphere for luminance measurements", Lighting Research
 * and Technology 1987) and Reinhart's subdivision, which cuts each of them except the zenith patch into n x n.
 *
 * The sky has 7 n bands of 90 / (7 n + 1/2) degrees from the horizon up, and a cap at the zenith of half of that as its
 * radius. Bands have 30, 30, 24, 24, 18, 12 and 6 times n patches, n of them each. Patches are counted from the horizon
 * up, and within a band from -z towards +x, that is from north eastwards if north is -z. */
#ifndef KILN_WORKER_LIGHT_SKY_PATCHES_H
#define KILN_WORKER_LIGHT_SKY_PATCHES_H

#include "shaders/shared/sky_patch.h"

/* Number of patches, by n: 0, 1, 2 and 4 in the order of enum kiln_sky_patches (coordinator/job/choices.h). */
static const uint32_t kiln_sky_patches[] = {0, 145, 577, 2305};
static const uint32_t kiln_sky_divisions[] = {0, 1, 2, 4};

/* The unit direction of a patch's middle, and its solid angle, sr. */
static inline struct kiln_dvec3 kiln_sky_patch_middle(uint32_t patch, uint32_t n, double *steradians)
{
    const double height = kiln_sky_band_height(n);
    uint32_t band = 0, first = 0;
    while (band < 7 * n && patch >= first + n * kiln_sky_bands[band / n])
        first += n * kiln_sky_bands[band++ / n];
    if (band == 7 * n) {
        *steradians = 2.0 * KILN_PI * (1.0 - sin(band * height));
        return dvec3(0.0, 1.0, 0.0);
    }
    const uint32_t count = n * kiln_sky_bands[band / n];
    const double azimuth = 2.0 * KILN_PI * (patch - first) / count, altitude = (band + 0.5) * height;
    *steradians = 2.0 * KILN_PI / count * (sin((band + 1) * height) - sin(band * height));
    return dvec3(sin(azimuth) * cos(altitude), sin(altitude), -cos(azimuth) * cos(altitude));
}

#endif
