/* Divided texels (struct kiln_divided_texel of worker/scene/surface.h), in C and GLSL: finds the part of a texel that
 * contains a position.
 *
 * Up to KILN_CUT_LINES lines cut the texel into cells. Line i is a x + b y = c, with a, b and c at 3 i of `lines`, a^2
 * + b^2 = 1, and x and y from 0 to 1 over the texel. Bit i of a cell's code is 1 where a x + b y > c. A cell's subtexel
 * stands at bit 4 x code of the codes. */
#ifndef KILN_SHADERS_SHARED_DIVIDED_H
#define KILN_SHADERS_SHARED_DIVIDED_H

#include "shaders/shared/language.h"

#define KILN_CUT_LINES 4
#define KILN_CUT_FLOATS 12     /* of the lines */
#define KILN_SUBTEXELS 4       /* of a texel, at most */
#define KILN_SUBTEXEL_NONE 15u /* a cell without a subtexel: no light is there */

/* Sets bit i, of line i, in the two codes of a position. `beyond`: signed distance of the position beyond the line.
 * `sure` gets the bit if the position is surely beyond it, `perhaps` if it may be, within `margin`. */
KILN_FUNCTION void kiln_cut_add(float beyond, float margin, KILN_U32 i, KILN_INOUT(KILN_U32) sure,
                                KILN_INOUT(KILN_U32) perhaps)
{
    if (beyond > margin)
        KILN_AT(sure) |= 1u << i;
    if (beyond > -margin)
        KILN_AT(perhaps) |= 1u << i;
}

/* Returns the part of the cell with this code; `low` and `high` are the two words of all cells' parts. */
KILN_FUNCTION KILN_U32 kiln_cut_subtexel(KILN_U32 low, KILN_U32 high, KILN_U32 code)
{
    return (code < 8u ? low >> (4u * code) : high >> (4u * code - 32u)) & 15u;
}

#endif
