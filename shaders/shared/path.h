/* Parts of the path pass (worker/pass/path.h) that both backends share: camera rays, random numbers of a path, and
 * termination of paths without a maximum number of bounces. */
#ifndef KILN_SHADERS_SHARED_PATH_H
#define KILN_SHADERS_SHARED_PATH_H

#include "shaders/shared/bsdf.h"
#include "shaders/shared/random.h"

/* ---- random numbers ---- */

/* XORed with the seed's upper half for pixels, so that they draw other numbers than texels and probes. */
#define KILN_PATH_SEED 0x70617468u

/* Uses of a path's random numbers. Use 0 is the place in the pixel. Each surface that the path meets has KILN_PATH_USES
 * more, from 1 + KILN_PATH_USES * (number of the surface) on. */
#define KILN_PATH_BOUNCE 0u /* the direction in which the path goes on, or came to this surface */
#define KILN_PATH_LIGHT 1u  /* the place on a light */
#define KILN_PATH_PICK 2u   /* which light */
#define KILN_PATH_SKY 3u    /* the direction to the environment, by the cosine; then by its luminance */
#define KILN_PATH_CHANCE 5u /* which partly transparent surfaces are hit on the way to this surface */
#define KILN_PATH_END 6u    /* whether the path ends here */
#define KILN_PATH_LOBE 7u   /* which lobes of the surface scatter the path */
#define KILN_PATH_USES 8u
KILN_FUNCTION KILN_U32 kiln_path_use(KILN_U32 surface, KILN_U32 use) { return 1u + KILN_PATH_USES * surface + use; }

/* Key of the numbers of a pixel's paths for one use; `key` is the pixel's. */
KILN_FUNCTION KILN_U32 kiln_path_key(KILN_U32 key, KILN_U32 use) { return kiln_hash2(key, use); }

/* Second dimension of a 32-bit Sobol' point, computed since a table would be too long, as a fraction of 2^32. The
 * dimension's matrix is Pascal's triangle modulo 2: if the index's digits are coefficients of a polynomial in t, the
 * point's digits are its coefficients in powers of t + 1. */
KILN_FUNCTION KILN_U32 kiln_path_sobol_second(KILN_U32 index)
{
    KILN_U32 x = index;
    x ^= x >> 16;
    x ^= (x & 0xff00ff00u) >> 8;
    x ^= (x & 0xf0f0f0f0u) >> 4;
    x ^= (x & 0xccccccccu) >> 2;
    x ^= (x & 0xaaaaaaaau) >> 1;
    return kiln_reverse_bits(x);
}

/* Two random numbers of sample k for the use of this key, as fractions of 2^32: an Owen-scrambled Sobol' point. Its
 * index is shuffled by Owen scrambling, too, so that the points of two uses are independent, and the first 2^m samples
 * of each are a net (Burley, "Practical Hash-based Owen Scrambling", JCGT 2020, section 5). */
KILN_FUNCTION void kiln_path_numbers(KILN_U32 key, KILN_U32 k, KILN_OUT(KILN_U32) u, KILN_OUT(KILN_U32) v)
{
    const KILN_U32 index = kiln_owen_scramble(k, kiln_hash1(key + 1u));
    KILN_AT(u) = kiln_owen_scramble(kiln_reverse_bits(index), kiln_hash1(key + 2u));
    KILN_AT(v) = kiln_owen_scramble(kiln_path_sobol_second(index), kiln_hash1(key + 3u));
}

/* ---- the camera ---- */

/* Use of the numbers of a place on the lens, instead of a surface's use. */
#define KILN_PATH_LENS 0x6c656e73u

/* Offset on a lens of radius `radius` (m), from its middle, at which a camera ray starts. `right` and `up` are the
 * camera's axes, of any length; u and v are in (0, 1). Let p be the point in focus on the ray through the lens' middle:
 * the new ray goes from the offset place through p (Cook, Porter and Carpenter, "Distributed Ray Tracing", SIGGRAPH
 * 1984). */
KILN_FUNCTION KILN_VECTOR kiln_path_lens(KILN_VECTOR right, KILN_VECTOR up, float radius, float u, float v)
{
    const KILN_VECTOR disc = kiln_bsdf_cosine(u, v);
    const KILN_VECTOR aside = vec3_scale(right, radius * disc.x / vec3_length(right));
    return vec3_madd(aside, up, radius * disc.y / vec3_length(up));
}

/* ---- lengths of paths ---- */

/* Value for the number of bounces: no limit, paths end by chance alone. */
#define KILN_PATH_ALL_BOUNCES 0xffffffffu
/* Number of the surface from which on paths end by chance (Russian roulette). The survival probability is the largest
 * colour channel of the light that the path could still bring, at most KILN_PATH_CHANCE_MOST; survivors are weighted by
 * its inverse (Arvo and Kirk, "Particle Transport and Image Synthesis", SIGGRAPH 1990). */
#define KILN_PATH_CERTAIN 4u
#define KILN_PATH_CHAIN 8u /* the same after so many mirrors, glass or gloss surfaces in a row */
#define KILN_PATH_CHANCE_MOST KILN_RATIO32(19, 20)
KILN_FUNCTION float kiln_path_chance(float red, float green, float blue)
{
    const float most = red > green ? (red > blue ? red : blue) : (green > blue ? green : blue);
    return most < KILN_PATH_CHANCE_MOST ? most : KILN_PATH_CHANCE_MOST;
}

/* Value for the maximum length of paths: no limit. */
#define KILN_PATH_LENGTH_ANY 0u
/* Whether paths may have so many rays between light and camera. */
KILN_FUNCTION bool kiln_path_allows(KILN_U32 length, KILN_U32 rays)
{
    return length == KILN_PATH_LENGTH_ANY || rays <= length;
}

/* ---- lobes ---- */

/* Lobes whose facets have an alpha up to this are sharp. Light of lamps and sky by sharp lobes is found by the path's
 * own rays when they hit it; by other lobes it is found by light samples. Lights that no ray can hit are always
 * sampled. */
#define KILN_PATH_SHARP KILN_RATIO32(1, 5)

/* Returns the sharp lobes of a material; all that glass transmits counts as sharp. */
KILN_FUNCTION KILN_U32 kiln_path_sharp(float alpha_x, float alpha_y, float coat_alpha, bool glass)
{
    const bool base = glass || float_max(alpha_x, alpha_y) <= KILN_PATH_SHARP;
    return (base ? KILN_LOBE_GLOSS : 0u) | (coat_alpha <= KILN_PATH_SHARP ? KILN_LOBE_COAT : 0u);
}

/* ---- what the camera sees ---- */

/* Maximum number of surfaces hidden from the camera that a camera ray passes; kiln_path_beyond gives the distance at
 * which it continues behind one. */
#define KILN_PATH_UNSEEN 64u
KILN_FUNCTION float kiln_path_beyond(float distance, float extent)
{
    return distance * (1.0f + 1.0e-6f) + 1.0e-6f * extent;
}

#endif
