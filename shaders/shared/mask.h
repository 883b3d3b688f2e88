/* Masks of a surface point, the same in C and GLSL. The square (s, t) in (0, 1)^2, from which places of the point are
 * drawn, has 16 x 16 cells. A bit for each cell says whether places in it are drawn. Cell (x, y) is bit b of word w,
 * where the binary digits of 32 w + b are those of x and y in turn, x lowest. Consecutive bits are so neighbouring
 * cells, which keeps stratified places stratified. */
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

/* Position of the n-th set bit of `word`, n from 0 on; the word must have more than n set bits. */
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

/* Chooses among `count` set cells by the coordinate s of a place: the integer part of s * count is the cell's number,
 * the fraction, in `rest`, the coordinate within it. */
KILN_FUNCTION KILN_U32 kiln_mask_choose(float s, KILN_U32 count, KILN_OUT(float) rest)
{
    const float scaled = s * KILN_TO_F32(count);
    const KILN_U32 n = word_min(KILN_TO_U32(scaled), count - 1u);
    KILN_AT(rest) = float_min(scaled - KILN_TO_F32(n), KILN_FLOAT_BELOW_ONE);
    return n;
}

/* Coordinates in the whole square of the place (s, t) within a cell. */
KILN_FUNCTION float kiln_mask_s(KILN_U32 cell, float s)
{
    return (KILN_TO_F32(kiln_cell_column(cell)) + s) / KILN_TO_F32(KILN_MASK_SIDE);
}
KILN_FUNCTION float kiln_mask_t(KILN_U32 cell, float t)
{
    return (KILN_TO_F32(kiln_cell_column(cell >> 1)) + t) / KILN_TO_F32(KILN_MASK_SIDE);
}

#endif
