/* Allocation of random numbers: dimensions of a sample, and hashes that seed them. The hashes of a texel and of a tile
 * are computed on the host for both backends (worker/sampling/keys.h). */
#ifndef KILN_SHADERS_SHARED_STREAMS_H
#define KILN_SHADERS_SHARED_STREAMS_H

#include "shaders/shared/random.h"

#define KILN_DIMENSION_U 0u /* direction, or point on a light */
#define KILN_DIMENSION_V 1u
#define KILN_DIMENSION_S 2u /* position in the texel */
#define KILN_DIMENSION_T 3u
#define KILN_DIMENSION_CHOICE 4u /* which light */
#define KILN_DIMENSIONS 5

/* ---- bounce pass ---- */

/* Scramble of one of the first four dimensions of a tile's samples. */
KILN_FUNCTION KILN_U32 kiln_gather_seed(KILN_U32 tile_key, KILN_U32 stream, KILN_U32 dimension)
{
    return kiln_hash2(tile_key, stream * 8u + dimension);
}
/* Digital shift of one dimension of a texel's samples; `key` is kiln_hash2(texel's key, stream). In dimensions U and V
 * the shift must not change the digits that the texels of a tile share: shift it right by their number. */
KILN_FUNCTION KILN_U32 kiln_gather_shift(KILN_U32 key, KILN_U32 dimension) { return kiln_hash1(key + 1u + dimension); }
/* Digital shift of a dimension that chooses a direction. Its leading `shared_digits` (kiln_shared_digits) are zero, so
 * that the samples stay in the strata that the texels of a tile share. */
KILN_FUNCTION KILN_U32 kiln_direction_shift(KILN_U32 key, KILN_U32 dimension, KILN_U32 shared_digits)
{
    return kiln_gather_shift(key, dimension) >> shared_digits;
}
/* Key of the random decisions of a texel's rays, and the seed of ray k from it. */
KILN_FUNCTION KILN_U32 kiln_gather_chance(KILN_U32 key) { return kiln_hash1(key + 5u); }
KILN_FUNCTION KILN_U32 kiln_gather_ray_seed(KILN_U32 chance, KILN_U32 k) { return kiln_hash2(chance, k); }

/* Streams of the occlusion and the directional pass; streams of gathers are below 0x10000. */
#define KILN_OCCLUSION_STREAM 0x10001u
#define KILN_DIRECTIONAL_STREAM 0x10002u
/* Added to the stream of the caustic pass, which is below 0x10000. */
#define KILN_CAUSTIC_STREAM 0x20000u

/* ---- samples of lights ---- */

/* Hash that identifies a choice of lights. The choice's strategies have consecutive values from here on. */
KILN_FUNCTION KILN_U32 kiln_choice_identity(KILN_U32 kind, KILN_U32 index) { return kiln_hash2(kind * 2u + 1u, index); }

/* Hash that identifies a choice of lights in a stream of the direct pass. */
KILN_FUNCTION KILN_U32 kiln_direct_identity(KILN_U32 kind, KILN_U32 index, KILN_U32 stream)
{
    const KILN_U32 identity = kiln_choice_identity(kind, index);
    return stream == 0u ? identity : kiln_hash2(identity, stream);
}

/* Least number of samples of a choice whose error is estimated from four quarters, each a net of its own. Quarter q
 * begins at sample kiln_quarter_first(q, samples); sample k belongs to quarter k * 4 / samples. */
#define KILN_QUARTERS_FROM 8u
#ifdef KILN_GLSL
uint kiln_quarter_first(uint quarter, uint samples) { return uint((uint64_t(quarter) * samples + 3ul) / 4ul); }
#else
static inline uint32_t kiln_quarter_first(uint32_t quarter, uint32_t samples)
{
    return (uint32_t)(((uint64_t)quarter * samples + 3) / 4);
}
#endif

/* ---- validity pass: two tests of places of a point ---- */

#define KILN_VALIDITY_FIRST_STREAM 0x76616c31u
#define KILN_VALIDITY_SECOND_STREAM 0x76616c32u
#define KILN_VALIDITY_FIRST_LOOK 16u
#define KILN_VALIDITY_SECOND_LOOK 64u
/* Key of a point's tested places. It depends neither on the seed nor on the point: which points are buried is a
 * property of the scene. */
KILN_FUNCTION KILN_U32 kiln_validity_key(KILN_U32 stream) { return kiln_hash1(stream); }

/* Maximum number of times that a buried place of a partly buried point is drawn again; try i uses this hash. */
#define KILN_BURIED_TRIES 32u
KILN_FUNCTION KILN_U32 kiln_buried_retry(float s, float t, KILN_U32 key, KILN_U32 i)
{
    return kiln_hash2(kiln_hash2(KILN_TO_U32(s * 16777216.0f), KILN_TO_U32(t * 16777216.0f)), key + i);
}

/* Key, instead of the seed's, of the places at which a point with an opacity mask is searched for its surface. They
 * depend on the texel, not on the seed. */
#define KILN_LOOKS_KEY 0x6c6f6f6bu

/* Maximum number of tries to draw a place of a masked point where its surface is present. The hash of try i decides
 * whether the surface is there (kiln_is_there), and gives the next place: kiln_unit_float of it, and of kiln_hash1 of
 * it. */
#define KILN_PLACE_TRIES 64u
KILN_FUNCTION KILN_U32 kiln_place_try(float s, float t, KILN_U32 key, KILN_U32 i)
{
    return kiln_hash2(kiln_hash2(KILN_TO_U32(s * 16777216.0f), KILN_TO_U32(t * 16777216.0f)), kiln_hash1(key) + i);
}

/* Directions that test whether a place is buried. It is if a ray along the normal and three around it, 53 degrees off,
 * all hit backs. The three are 0.6 of the normal plus, in tangent coordinates, (0.8, 0) turned by thirds. At most
 * KILN_BURIED_BOTH of the rays may also hit a front in the same place. */
#define KILN_BURIED_BOTH 1
#define KILN_BURIED_ALONG 0.6f
#define KILN_BURIED_ACROSS 0.8f
#define KILN_BURIED_HALF 0.4f
#define KILN_BURIED_SIDE 0.6928f

/* ---- probes ---- */

/* XORed with the seed's upper half for probes, so that they draw other numbers than texels. */
#define KILN_PROBE_SEED 0x70726f62u
/* Bits of a word: kinds of lamps whose light by sharp lobes is left to light paths (worker/pass/spheres.h): emitting
 * surfaces; points, spots and directional lights; an environment with an image. */
#define KILN_LEAVES_AREAS 1u
#define KILN_LEAVES_POINTS 2u
#define KILN_LEAVES_IMAGE 4u
/* XORed with the seed's upper half for radiance probes. */
#define KILN_RADIANCE_SEED 0x72616469u
/* Key of a map element's samples, for the numbers of its places; and seed of the random decisions of its ray k. */
KILN_FUNCTION KILN_U32 kiln_radiance_key(KILN_U32 seed, KILN_U32 stream, KILN_U32 low, KILN_U32 high)
{
    return kiln_hash2(kiln_hash2(kiln_hash2(seed, stream), low), high);
}
KILN_FUNCTION KILN_U32 kiln_radiance_chance(KILN_U32 key, KILN_U32 k) { return kiln_hash2(key + 1u, k); }
/* Random number by which a gather ray with the seed kiln_gather_ray_seed chooses its probe. */
KILN_FUNCTION KILN_U32 kiln_probe_choice(KILN_U32 ray_seed) { return kiln_hash1(ray_seed + 0x70726f62u); }

/* ---- rays of kiln_backend_intersect ---- */

/* The seed of a ray of kiln_backend_intersect, from the bits of its origin and direction. */
KILN_FUNCTION KILN_U32 kiln_ray_bits_seed(KILN_U32 ox, KILN_U32 oy, KILN_U32 oz, KILN_U32 dx, KILN_U32 dy, KILN_U32 dz)
{
    return kiln_hash2(kiln_hash2(kiln_hash2(ox, oy), kiln_hash2(oz, dx)), kiln_hash2(dy, dz));
}

#endif
