/* The path pass (worker/pass/path.h): what both backends share of it. Camera rays, the random numbers of a path, and
 * how long paths are that have no last bounce. */
#ifndef KILN_SHADERS_SHARED_PATH_H
#define KILN_SHADERS_SHARED_PATH_H

#include "shaders/shared/bsdf.h"
#include "shaders/shared/random.h"

/* ---- random numbers ---- */

/* With the seed's upper half, in place of it: pixels draw other numbers than texels and probes. */
#define KILN_PATH_SEED 0x70617468u

/* Uses of a path's numbers: the place in the pixel, and for each surface that the path meets KILN_PATH_USES more, from
 * 1 + KILN_PATH_USES * (number of the surface) on. */
#define KILN_PATH_BOUNCE 0u /* the direction in which the path goes on, or came to this surface */
#define KILN_PATH_LIGHT 1u  /* the place on a light */
#define KILN_PATH_PICK 2u   /* which light */
#define KILN_PATH_SKY 3u    /* the direction to the environment, by the cosine; then by its luminance */
#define KILN_PATH_CHANCE 5u /* what is there of surfaces that let light through, on the way to this surface */
#define KILN_PATH_END 6u    /* whether the path ends here */
#define KILN_PATH_LOBE 7u   /* which lobes of the surface send the path on */
#define KILN_PATH_USES 8u
KILN_FUNCTION KILN_U32 kiln_path_use(KILN_U32 surface, KILN_U32 use) { return 1u + KILN_PATH_USES * surface + use; }

/* Key of the numbers of a pixel's paths for one use; `key` is the pixel's. */
KILN_FUNCTION KILN_U32 kiln_path_key(KILN_U32 key, KILN_U32 use) { return kiln_hash2(key, use); }

/* Sobol' points of 32 bits, whose table would be too long, in the first two dimensions, as fractions of 2^32. The
 * second one's matrix is Pascal's triangle modulo 2: the digits are the coefficients of the index, taken for a
 * polynomial in t, in powers of t + 1. */
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

/* Two numbers of sample k for the use with this key, as fractions of 2^32: a Sobol' point, Owen-scrambled, of an index
 * that is shuffled by Owen's scrambling too, so that the points of two uses are independent of each other, and the
 * first 2^m samples are a net in each (Burley, "Practical Hash-based Owen Scrambling", JCGT 2020, section 5). */
KILN_FUNCTION void kiln_path_numbers(KILN_U32 key, KILN_U32 k, KILN_OUT(KILN_U32) u, KILN_OUT(KILN_U32) v)
{
    const KILN_U32 index = kiln_owen_scramble(k, kiln_hash1(key + 1u));
    KILN_AT(u) = kiln_owen_scramble(kiln_reverse_bits(index), kiln_hash1(key + 2u));
    KILN_AT(v) = kiln_owen_scramble(kiln_path_sobol_second(index), kiln_hash1(key + 3u));
}

/* ---- the camera ---- */

/* Numbers of a place on the lens, in place of a surface's use. */
#define KILN_PATH_LENS 0x6c656e73u

/* Where on a lens of this radius (m) a camera ray starts, from its middle; `right` and `up` are the camera's axes, of
 * any length, and u and v are in (0, 1). A ray through the middle towards p goes from there towards p, where p lies at
 * the distance on which the lens is focused (Cook, Porter and Carpenter, "Distributed Ray Tracing", SIGGRAPH 1984). */
KILN_FUNCTION KILN_VECTOR kiln_path_lens(KILN_VECTOR right, KILN_VECTOR up, float radius, float u, float v)
{
    const KILN_VECTOR disc = kiln_bsdf_cosine(u, v);
    const KILN_VECTOR aside = vec3_scale(right, radius * disc.x / vec3_length(right));
    return vec3_madd(aside, up, radius * disc.y / vec3_length(up));
}

/* ---- lengths of paths ---- */

/* In place of the number of bounces: paths end by chance alone. */
#define KILN_PATH_ALL_BOUNCES 0xffffffffu
/* From this surface on they go on with a chance that is the largest of the colours of what light a path would bring
 * yet, at most KILN_PATH_CHANCE_MOST, and count the more for it (Arvo and Kirk, "Particle Transport and Image
 * Synthesis", SIGGRAPH 1990). */
#define KILN_PATH_CERTAIN 4u
#define KILN_PATH_CHAIN 8u /* and so do paths that meet so many mirrors, glass or gloss one after another */
#define KILN_PATH_CHANCE_MOST KILN_RATIO32(19, 20)
KILN_FUNCTION float kiln_path_chance(float red, float green, float blue)
{
    const float most = red > green ? (red > blue ? red : blue) : (green > blue ? green : blue);
    return most < KILN_PATH_CHANCE_MOST ? most : KILN_PATH_CHANCE_MOST;
}

/* In place of the length of paths at most: they may have any. */
#define KILN_PATH_LENGTH_ANY 0u
/* Whether paths may have so many rays between light and camera. */
KILN_FUNCTION bool kiln_path_allows(KILN_U32 length, KILN_U32 rays)
{
    return length == KILN_PATH_LENGTH_ANY || rays <= length;
}

/* ---- lobes ---- */

/* Up to this alpha of its facets a lobe is sharp: light of lamps and sky that it sends on is what the path's own rays
 * meet. The light of others is what samples of lamps and sky bring. Of lights that no ray can meet all is theirs. */
#define KILN_PATH_SHARP KILN_RATIO32(1, 5)

/* The sharp lobes of a material: all that glass lets through is. */
KILN_FUNCTION KILN_U32 kiln_path_sharp(float alpha_x, float alpha_y, float coat_alpha, bool glass)
{
    const bool base = glass || float_max(alpha_x, alpha_y) <= KILN_PATH_SHARP;
    return (base ? KILN_LOBE_GLOSS : 0u) | (coat_alpha <= KILN_PATH_SHARP ? KILN_LOBE_COAT : 0u);
}

/* ---- what the camera sees ---- */

/* A camera ray goes on behind so many surfaces that it does not see, at most, and so far behind each of them. */
#define KILN_PATH_UNSEEN 64u
KILN_FUNCTION float kiln_path_beyond(float distance, float extent)
{
    return distance * (1.0f + 1.0e-6f) + 1.0e-6f * extent;
}

#endif
