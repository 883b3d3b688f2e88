/* Where on a surface point something may be, the same in C and GLSL: the square of (s, t) in (0, 1)^2 from which places
 * of the point are drawn is cut into 16 x 16 cells, and a bit says of each whether its places are drawn. Cell (x, y) is
 * bit 32 w + b of word w, whose binary digits are those of x and y in turn, x lowest: consecutive bits are neighbours,
 * so that places which were drawn in strata stay so. */
#ifndef KILN_SHADERS_MASK_H
#define KILN_SHADERS_MASK_H

#include "shaders/shared/random.h"

#define KILN_MASK_SIDE 16u
#define KILN_MASK_WORDS 8u

#ifdef KILN_GLSL
#    define KILN_COUNT_BITS(x) uint(bitCount(x))
#else
#    define KILN_COUNT_BITS(x) ((uint32_t)__builtin_popcount(x))
#endif

/* Place of the n-th set bit of `word`, n from 0 on: there must be more than n. */
KILN_FUNCTION KILN_U32 kiln_set_bit(KILN_U32 word, KILN_U32 n)
{
    KILN_U32 at = 0u;
    for (KILN_U32 width = 16u; width != 0u; width >>= 1) {
        const KILN_U32 below = KILN_COUNT_BITS(word >> at & ((1u << width) - 1u));
        if (n >= below) {
            n -= below;
            at += width;
        }
    }
    return at;
}

/* Column of a cell; its row is the column of cell >> 1. */
KILN_FUNCTION KILN_U32 kiln_cell_column(KILN_U32 cell)
{
    return (cell & 1u) | (cell >> 1 & 2u) | (cell >> 2 & 4u) | (cell >> 3 & 8u);
}

/* Largest float below 1. */
#define KILN_FLOAT_BELOW_ONE 0.999999940395355224609375f

/* A place's s, times the set cells' number `count`, is the n-th of them and where in it. */
KILN_FUNCTION KILN_U32 kiln_mask_choose(float s, KILN_U32 count, KILN_OUT(float) rest)
{
    const float scaled = s * KILN_TO_F32(count);
    const KILN_U32 n = word_min(KILN_TO_U32(scaled), count - 1u);
    KILN_AT(rest) = float_min(scaled - KILN_TO_F32(n), KILN_FLOAT_BELOW_ONE);
    return n;
}

/* The place (s, t) within a cell as one of the whole square. */
KILN_FUNCTION float kiln_mask_s(KILN_U32 cell, float s)
{
    return (KILN_TO_F32(kiln_cell_column(cell)) + s) / KILN_TO_F32(KILN_MASK_SIDE);
}
KILN_FUNCTION float kiln_mask_t(KILN_U32 cell, float t)
{
    return (KILN_TO_F32(kiln_cell_column(cell >> 1)) + t) / KILN_TO_F32(KILN_MASK_SIDE);
}

#endif
