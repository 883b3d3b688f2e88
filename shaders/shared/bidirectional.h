/* Code of the bidirectional pass (worker/pass/bidirectional.h) common to both backends, except for the weights. */
#ifndef KILN_SHADERS_SHARED_BIDIRECTIONAL_H
#define KILN_SHADERS_SHARED_BIDIRECTIONAL_H

#include "shaders/shared/bidirectional_weights.h"
#include "shaders/shared/path.h"
#include "shaders/shared/random.h"

/* Combined with the upper half of the seed, so that light paths draw other random numbers than camera paths. */
#define KILN_LIGHT_PATH_SEED 0x6c696774u

/* Seed constant for light paths of the reference pass (worker/pass/reference.h), whose paths from surface points also
 * depend on the upper half of the seed. */
#define KILN_REFERENCE_LIGHT_SEED 0x6c697266u

/* Use of the random numbers for a light path's first ray, that of a surface no path reaches. The numbers choose the
 * light, the place and the direction. */
#define KILN_EMISSION_USE 0x40000000u

/* Use of the random numbers for the lens point to which a surface is connected. Light paths do not sample lights, so
 * they have these numbers free. */
#define KILN_LENS_USE KILN_PATH_LIGHT

/* Returns the density of the camera's rays, per m2 of a surface at a place with this cosine. `towards`: unit direction
 * from the place to the camera; `distance`: m; `pixel`: area of a pixel at 1 m before the camera, or of an orthographic
 * camera at any distance, m2. */
KILN_FUNCTION kiln_real kiln_camera_density(bool orthographic, KILN_VECTOR towards, KILN_VECTOR forward,
                                            kiln_real distance, kiln_real cosine, kiln_real pixel)
{
    if (orthographic)
        return cosine / pixel;
    const kiln_real ahead = -kiln_real_of(vec3_dot(towards, forward));
    return cosine / (pixel * ahead * ahead * ahead * distance * distance);
}

/* Hash grid of photons, with cells twice as wide as the merging radius. kiln_photon_cell gives one coordinate of the
 * cell of a place (m), shifted by a fraction of a cell. kiln_photon_bucket gives the bucket of a cell, of `mask` + 1
 * buckets. */
#ifdef KILN_GLSL
#    define KILN_CELL int
#    define KILN_TO_CELL(x) int(x)
#else
#    define KILN_CELL int64_t
#    define KILN_TO_CELL(x) ((int64_t)(x))
#endif
KILN_FUNCTION KILN_CELL kiln_photon_cell(float place, kiln_real radius, kiln_real shift)
{
    const kiln_real scale = KILN_RATIO(1, 2) / radius;
    return KILN_TO_CELL(real_floor(kiln_real_of(place) * scale + shift));
}

KILN_FUNCTION KILN_U32 kiln_photon_bucket(KILN_CELL x, KILN_CELL y, KILN_CELL z, KILN_U32 mask)
{
    return kiln_hash2(kiln_hash2(KILN_TO_U32(x), KILN_TO_U32(y)), KILN_TO_U32(z)) & mask;
}

#endif
