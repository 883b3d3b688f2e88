/* Divided texels (struct kiln_divided_texel of worker/scene/surface.h), in both languages: which part of a texel a
 * place lies in.
 *
 * Up to KILN_CUT_LINES lines cut the texel into cells. Line i is a x + b y = c, with a, b and c at 3 i of `lines`, a^2
 * + b^2 = 1, and x and y from 0 to 1 over the texel. Bit i of a cell's code is 1 where a x + b y > c. A cell's part
 * stands at bit 4 x code of the codes. */
#ifndef KILN_SHADERS_SHARED_DIVIDED_H
#define KILN_SHADERS_SHARED_DIVIDED_H

#include "shaders/shared/language.h"

#define KILN_CUT_LINES 4
#define KILN_CUT_FLOATS 12 /* of the lines */
#define KILN_TEXEL_PARTS 4 /* of a texel, at most */
#define KILN_PART_NONE 15u /* a cell without a part: no light is there */

/* Adds to the two codes of a place what line i, on whose far side the place lies by `beyond`, says: `sure` gets the bit
 * where the place is surely beyond, `perhaps` where it may be. */
KILN_FUNCTION void kiln_cut_add(float beyond, float margin, KILN_U32 i, KILN_INOUT(KILN_U32) sure,
                                KILN_INOUT(KILN_U32) perhaps)
{
    if (beyond > margin)
        KILN_AT(sure) |= 1u << i;
    if (beyond > -margin)
        KILN_AT(perhaps) |= 1u << i;
}

/* The part of a cell; `low` and `high` are the two words of the codes. */
KILN_FUNCTION KILN_U32 kiln_cut_part(KILN_U32 low, KILN_U32 high, KILN_U32 code)
{
    return (code < 8u ? low >> (4u * code) : high >> (4u * code - 32u)) & 15u;
}

#endif
