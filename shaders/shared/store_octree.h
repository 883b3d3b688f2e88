/* The octree as a store (worker/store/octree.h), in both languages: from a hit to a leaf, and from a leaf's brick to
 * its slot. */
#ifndef KILN_SHADERS_SHARED_STORE_OCTREE_H
#define KILN_SHADERS_SHARED_STORE_OCTREE_H

#include "shaders/shared/language.h"
#include "shaders/shared/random.h"

#define KILN_LEAVES_ALONG 2097152 /* leaves along a side of the grid, at most */
#define KILN_SIDES 6
#define KILN_BRICK_SIDE 4 /* leaves along a side of a brick */

/* Index of the leaf at a coordinate from kiln_texel_coordinate (shaders/shared/store_lightmap.h). */
KILN_FUNCTION KILN_U32 kiln_leaf_of(float coordinate)
{
    return KILN_TO_U32(integer_clamp(KILN_TO_I32(coordinate), 0, KILN_LEAVES_ALONG - 1));
}

/* Bit of a leaf in its brick: the low two bits of x, y and layer interleaved, x lowest. */
KILN_FUNCTION KILN_U32 kiln_morton4(KILN_U32 x, KILN_U32 y, KILN_U32 layer)
{
    return (x & 1u) | (y & 1u) << 1 | (layer & 1u) << 2 | (x & 2u) << 2 | (y & 2u) << 3 | (layer & 2u) << 4;
}

/* A brick's place in one word of 64 bits: 19 bits each of x, y and layer, in bricks. The halves: */
KILN_FUNCTION KILN_U32 kiln_brick_low(KILN_U32 x, KILN_U32 y) { return x | y << 19; }
KILN_FUNCTION KILN_U32 kiln_brick_high(KILN_U32 y, KILN_U32 layer) { return y >> 13 | layer << 6; }

/* Slot at which the search for an octree's brick begins (hash); the number of slots is a power of two. */
KILN_FUNCTION KILN_U32 kiln_brick_hash(KILN_U32 low, KILN_U32 high, KILN_U32 octree)
{
    return kiln_hash2(low, kiln_hash2(high, octree));
}

#endif
