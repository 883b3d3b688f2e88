/* The bidirectional pass (worker/pass/bidirectional.h): what both backends share of it beside the weights. */
#ifndef KILN_SHADERS_SHARED_BIDIRECTIONAL_H
#define KILN_SHADERS_SHARED_BIDIRECTIONAL_H

#include "shaders/shared/bidirectional_weights.h"
#include "shaders/shared/path.h"
#include "shaders/shared/random.h"

/* With the seed's upper half, in place of it: paths of light draw other numbers than the camera's. */
#define KILN_LIGHT_PATH_SEED 0x6c696774u

/* The same of the paths from surface points (worker/pass/reference.h), whose own numbers hang on it too. */
#define KILN_REFERENCE_LIGHT_SEED 0x6c697266u

/* The numbers of a path's first ray have the uses of a surface that no path has: which light; the place; the direction.
 */
#define KILN_EMISSION_USE 0x40000000u

/* Paths of light sample no lights: these numbers of a surface choose the place on the lens that it is connected to. */
#define KILN_LENS_USE KILN_PATH_LIGHT

/* Returns the density of the camera's rays, per m2, at a place with this cosine. `towards`: unit, from the place to the
 * camera, at a distance in m; `pixel`: m2, at 1 m before the camera, or of an orthographic one anywhere. */
KILN_FUNCTION kiln_real kiln_camera_density(bool orthographic, KILN_VECTOR towards, KILN_VECTOR forward,
                                            kiln_real distance, kiln_real cosine, kiln_real pixel)
{
    if (orthographic)
        return cosine / pixel;
    const kiln_real ahead = -kiln_real_of(vec3_dot(towards, forward));
    return cosine / (pixel * ahead * ahead * ahead * distance * distance);
}

/* Cells of photons are as wide as twice the radius of merging: a coordinate of the cell of a place, m, shifted by a
 * share of a cell; and the bucket that a cell falls into, of one more than `mask`. */
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
