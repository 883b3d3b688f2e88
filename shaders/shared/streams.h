/* Which random numbers go to what: dimensions of a sample, and the hashes that random numbers hang on. The hashes of a
 * texel and of a tile are made on the host for both backends (worker/sampling/keys.h). */
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
/* Digital shift of a dimension of a texel's samples; `key` is kiln_hash2(texel's key, stream). Dimensions U and V leave
 * the digits alone that the texels of a tile share: shift it right by their number. */
KILN_FUNCTION KILN_U32 kiln_gather_shift(KILN_U32 key, KILN_U32 dimension) { return kiln_hash1(key + 1u + dimension); }
/* The same of a dimension that chooses a direction: the leading `shared_digits` (kiln_shared_digits) are zero, so that
 * the samples stay in the strata that the texels of a tile share. */
KILN_FUNCTION KILN_U32 kiln_direction_shift(KILN_U32 key, KILN_U32 dimension, KILN_U32 shared_digits)
{
    return kiln_gather_shift(key, dimension) >> shared_digits;
}
/* Key of the chances of a texel's rays, and the seed of ray k from it. */
KILN_FUNCTION KILN_U32 kiln_gather_chance(KILN_U32 key) { return kiln_hash1(key + 5u); }
KILN_FUNCTION KILN_U32 kiln_gather_ray_seed(KILN_U32 chance, KILN_U32 k) { return kiln_hash2(chance, k); }

/* In the place of a gather's stream, which is below 0x10000: the rays of the occlusion and the directional pass. */
#define KILN_OCCLUSION_STREAM 0x10001u
#define KILN_DIRECTIONAL_STREAM 0x10002u
/* Added to the stream of the caustic pass, which is below 0x10000. */
#define KILN_CAUSTIC_STREAM 0x20000u

/* ---- samples of lights ---- */

/* Name of a choice of lights; each of its strategies has one of its own, counted on from here. */
KILN_FUNCTION KILN_U32 kiln_choice_identity(KILN_U32 kind, KILN_U32 index) { return kiln_hash2(kind * 2u + 1u, index); }

/* The same in the direct pass, for one of its streams. */
KILN_FUNCTION KILN_U32 kiln_direct_identity(KILN_U32 kind, KILN_U32 index, KILN_U32 stream)
{
    const KILN_U32 identity = kiln_choice_identity(kind, index);
    return stream == 0u ? identity : kiln_hash2(identity, stream);
}

/* From this many samples of a choice on, its error is that of four quarters, each a net of its own; quarter q begins at
 * sample kiln_quarter_first(q, samples), and sample k is of quarter k * 4 / samples. */
#define KILN_QUARTERS_FROM 8u
#ifdef KILN_GLSL
uint kiln_quarter_first(uint quarter, uint samples) { return uint((uint64_t(quarter) * samples + 3ul) / 4ul); }
#else
static inline uint32_t kiln_quarter_first(uint32_t quarter, uint32_t samples)
{
    return (uint32_t)(((uint64_t)quarter * samples + 3) / 4);
}
#endif

/* ---- validity pass: two looks at places of a point ---- */

#define KILN_VALIDITY_FIRST_STREAM 0x76616c31u
#define KILN_VALIDITY_SECOND_STREAM 0x76616c32u
#define KILN_VALIDITY_FIRST_LOOK 16u
#define KILN_VALIDITY_SECOND_LOOK 64u
/* Where a point's places lie hangs on neither the seed nor the point: which points are buried is a property of the
 * scene. */
KILN_FUNCTION KILN_U32 kiln_validity_key(KILN_U32 stream) { return kiln_hash1(stream); }

/* A place of a partly buried point that is buried itself is drawn again, so often at most; try i by this hash. */
#define KILN_BURIED_TRIES 32u
KILN_FUNCTION KILN_U32 kiln_buried_retry(float s, float t, KILN_U32 key, KILN_U32 i)
{
    return kiln_hash2(kiln_hash2(KILN_TO_U32(s * 16777216.0f), KILN_TO_U32(t * 16777216.0f)), key + i);
}

/* Stands for the seed's key where a point with an opacity mask is looked at for its surface: those places hang on the
 * texel, not on the seed. */
#define KILN_LOOKS_KEY 0x6c6f6f6bu

/* A place of such a point where its surface is not is drawn again, so often in all at most. Try i's hash decides
 * whether something is there (kiln_is_there), and gives the next place: kiln_unit_float of it, and of kiln_hash1 of it.
 */
#define KILN_PLACE_TRIES 64u
KILN_FUNCTION KILN_U32 kiln_place_try(float s, float t, KILN_U32 key, KILN_U32 i)
{
    return kiln_hash2(kiln_hash2(KILN_TO_U32(s * 16777216.0f), KILN_TO_U32(t * 16777216.0f)), kiln_hash1(key) + i);
}

/* A place is buried where a ray along the normal and three around it, 53 degrees off, all meet backs: 0.6 of the normal
 * and, of the tangents, (0.8, 0) turned by thirds. So many of them may meet a front too, in the same place. */
#define KILN_BURIED_BOTH 1
#define KILN_BURIED_ALONG 0.6f
#define KILN_BURIED_ACROSS 0.8f
#define KILN_BURIED_HALF 0.4f
#define KILN_BURIED_SIDE 0.6928f

/* ---- probes ---- */

/* With the seed's upper half, in place of it: probes draw other numbers than texels. */
#define KILN_PROBE_SEED 0x70726f62u
/* Lamps whose light by sharp lobes is left to light paths (worker/pass/spheres.h), in one word: surfaces that emit;
 * points, spots and directional lights; an environment with an image. */
#define KILN_LEAVES_AREAS 1u
#define KILN_LEAVES_POINTS 2u
#define KILN_LEAVES_IMAGE 4u
/* The same of radiance probes. */
#define KILN_RADIANCE_SEED 0x72616469u
/* Key of an element's samples, for the numbers of its places; and seed of the chances of its ray k. */
KILN_FUNCTION KILN_U32 kiln_radiance_key(KILN_U32 seed, KILN_U32 stream, KILN_U32 low, KILN_U32 high)
{
    return kiln_hash2(kiln_hash2(kiln_hash2(seed, stream), low), high);
}
KILN_FUNCTION KILN_U32 kiln_radiance_chance(KILN_U32 key, KILN_U32 k) { return kiln_hash2(key + 1u, k); }
/* By which a gather ray with the seed kiln_gather_ray_seed chooses its probe. */
KILN_FUNCTION KILN_U32 kiln_probe_choice(KILN_U32 ray_seed) { return kiln_hash1(ray_seed + 0x70726f62u); }

/* ---- any rays ---- */

/* The seed of a ray of kiln_backend_intersect, from the bits of its origin and direction. */
KILN_FUNCTION KILN_U32 kiln_ray_bits_seed(KILN_U32 ox, KILN_U32 oy, KILN_U32 oz, KILN_U32 dx, KILN_U32 dy, KILN_U32 dz)
{
    return kiln_hash2(kiln_hash2(kiln_hash2(ox, oy), kiln_hash2(oz, dx)), kiln_hash2(dy, dz));
}

#endif
